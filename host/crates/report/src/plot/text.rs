//! Widths of text, so that labels are placed where nothing else is.

/// Size of text in figures, px.
pub const SIZE: f64 = 11.5;

/// Widths of Arial and its metric twins (Liberation Sans, Helvetica) in 1/1000 em, of the
/// characters from blank to tilde (font metrics of Liberation Sans 2).
#[rustfmt::skip]
const WIDTHS: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278,
    556, 556, 556, 556, 556, 556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556,
    1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833, 722, 778,
    667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556,
    333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556,
    556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584,
];

/// Width of text at [`SIZE`], px.
pub fn width(text: &str) -> f64 {
    let of = |c: char| match c {
        ' '..='~' => f64::from(WIDTHS[c as usize - ' ' as usize]),
        '⁰'..='⁻' | '¹' | '²' | '³' | '·' | '°' | '’' => 366.0,
        '\u{2009}' | '\u{202f}' => 200.0,
        '\u{a0}' => 278.0,
        _ => 620.0,
    };
    text.chars().map(of).sum::<f64>() * SIZE / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_of_one_width_and_text_adds_up() {
        assert_eq!(width("0"), 556.0 * SIZE / 1e3);
        assert!(('0'..='9').all(|c| width(&c.to_string()) == width("0")));
        assert!((width("100") - 3.0 * width("0")).abs() < 1e-12);
    }
}
