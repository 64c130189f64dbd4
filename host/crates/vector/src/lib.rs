//! [`vectorised`]: compiles a function once for each instruction set in one agreed list, and
//! chooses between the copies when the program runs.
//!
//! The list holds the vector parts of two levels of the x86-64 psABI: AVX-512 F, BW, CD, DQ and VL
//! (x86-64-v4), and AVX2 (x86-64-v3). Other processors run the function as compiled for the
//! target: SSE2 on x86-64, NEON on AArch64. The results are the same bits in every copy, because
//! the compiler neither reorders nor fuses floating-point operations; the list decides speed only.
//!
//! A crate that uses the attribute depends on `multiversion` too, which it expands to.
//!
//! ```
//! use camrig_vector::vectorised;
//!
//! /// Sum of squares, dimensionless.
//! #[vectorised]
//! fn energy(values: &[f32]) -> f32 {
//!     values.iter().map(|v| v * v).sum()
//! }
//!
//! assert_eq!(energy(&[3.0, 4.0]), 25.0);
//! ```

use proc_macro::TokenStream;

/// What the attribute expands to. `multiversion` narrows any AVX-512 target to processors from Ice
/// Lake on, because earlier ones lower their clock for it.
const ATTRIBUTE: &str = r#"#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl",
    "x86_64+avx2",
))]"#;

/// Compiles the function for AVX-512, for AVX2 and for the target's own instructions.
///
/// What the function calls takes part where it is inlined, so inner functions are
/// `#[inline(always)]`.
#[proc_macro_attribute]
pub fn vectorised(_arguments: TokenStream, function: TokenStream) -> TokenStream {
    match ATTRIBUTE.parse::<TokenStream>() {
        Ok(attribute) => attribute.into_iter().chain(function).collect(),
        Err(_) => function,
    }
}
