//! Codes of errors: names that stay when the words of a message change.

/// Declares the codes: what an error with this code says, and its name.
macro_rules! codes {
    ($($(#[doc = $doc:literal])+ $code:ident = $name:literal,)+) => {
        /// What an error is about, for programs that react to it or add words of their own.
        ///
        /// Only errors that a program may want to tell apart have one. `docs/reference.md` lists
        /// them all.
        ///
        /// ```
        /// use camrig_base::{Error, ErrorCode};
        ///
        /// let error = Error::input("a.npy exists").with_code(ErrorCode::OutputExists);
        /// assert_eq!(error.code().map(ErrorCode::name), Some("output-exists"));
        /// ```
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum ErrorCode {
            $($(#[doc = $doc])+ $code,)+
        }

        impl ErrorCode {
            /// All codes, sorted by name.
            pub const ALL: &[Self] = &[$(Self::$code),+];

            /// The code in text, such as `output-exists`.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$code => $name),+ }
            }

            /// What an error with this code says.
            #[must_use]
            pub const fn doc(self) -> &'static str {
                match self { $(Self::$code => concat!($($doc),+).trim_ascii()),+ }
            }
        }
    };
}

codes! {
    /// The lens is not rotationally symmetric, and what was asked for exists only for lenses that
    /// are.
    AsymmetricLens = "asymmetric-lens",
    /// This build has no support for graphics processors (feature `gpu`).
    BuiltWithoutGraphics = "built-without-graphics",
    /// Keys of a camera that no rule of thumb can stand in for are missing.
    CameraKeys = "camera-keys",
    /// A chart was given where a picture is needed: it has no pixels until it is drawn.
    ChartNotDrawn = "chart-not-drawn",
    /// The exposure times that captures state contradict their signals.
    ExposureTime = "exposure-time",
    /// A frame has more pixels or bands than the link to a rig can carry.
    FrameTooLarge = "frame-too-large",
    /// No graphics processor was found, it failed, or the work does not fit on it.
    GraphicsProcessor = "graphics-processor",
    /// The largest field angle of a lens is outside 0 to 90 degrees, or has too few heights.
    LargestField = "largest-field",
    /// A file of pixels does not state its bits, colour filters, black or white level.
    MissingFacts = "missing-facts",
    /// A capture set has no capture of an edge.
    NoEdgeCapture = "no-edge-capture",
    /// A file holds no irradiance cube, or that of another camera.
    NoIrradiance = "no-irradiance",
    /// There is no scene library in this directory.
    NoLibrary = "no-library",
    /// This operating system has no pseudo-terminals.
    NoPseudoTerminals = "no-pseudo-terminals",
    /// The output exists, and replacing it was not asked for.
    OutputExists = "output-exists",
    /// A patch of a chart lies outside the frame.
    PatchOutside = "patch-outside",
    /// The optics path cannot compute this scene or sensor.
    PathUnsupported = "path-unsupported",
    /// The wavefront is too strong for a PSF by diffraction.
    PsfMethod = "psf-method",
    /// No light falls into the window of a PSF.
    PsfWindow = "psf-window",
    /// A region lies outside the frame.
    RegionOutside = "region-outside",
    /// The rig does not have the arithmetic that was asked for.
    RigArithmetic = "rig-arithmetic",
    /// This is no address of a rig, or no rig was found there.
    RigNotFound = "rig-not-found",
    /// The rig has no such register, or the register does not take the value.
    RigRegister = "rig-register",
    /// Nothing answers at the network address of a rig.
    RigUnreachable = "rig-unreachable",
    /// Captures of a rotated camera are missing, or a plan asks for them.
    RotationStacks = "rotation-stacks",
    /// Size, pixel format and row length do not fit the length of the file.
    RowPadding = "row-padding",
    /// A capture is saturated where its signal is needed.
    SaturatedCapture = "saturated-capture",
    /// Several frames for a format that holds one.
    SeveralFrames = "several-frames",
    /// The radius of the lens's stop is not above zero.
    StopRadius = "stop-radius",
    /// No catalogue has this glass, or catalogues disagree on it.
    UnknownGlass = "unknown-glass",
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_and_unique() {
        assert!(ErrorCode::ALL.is_sorted_by(|a, b| a.name() < b.name()));
    }
}
