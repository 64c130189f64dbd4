//! Units as instruments and files write them: `W/m^2/sr/nm`, `µW·cm⁻²·nm⁻¹`, `mW/(m2 sr um)`,
//! `Watts/meter^2/steradian/micrometer`, `per cent`, `photons/s`.
//!
//! ```text
//! product = term { ("/" | "per" | "*" | "." | "·" | "×" | blank) term }      from left to right
//! term    = number | symbol [power] | ("square" | "cubic") symbol | "(" product ")" [power]
//! power   = ["^" | "**"] ["+" | "-"] digits, or superscripts
//! ```
//! Symbols are those of the SI with its prefixes, written out or not, and what light is measured
//! in. Letter case counts first; where a unit is not understood in its own, case is ignored, but
//! for the prefixes M and P, which would then have two meanings. What is not understood is
//! refused.
//!
//! Dimensions tell apart what the SI has as one: areas and wavelengths are both lengths there, so
//! that W per nm and W m⁻² per cm⁻¹ are the same. Here nm, µm and Å are units of wavelength, and
//! cm⁻¹ under a stroke is one of wavenumber.
//!
//! ```
//! use camrig_base::unit::Unit;
//!
//! let radiance = Unit::parse("uW/cm^2/sr/um")?;
//! assert_eq!(radiance.radiance(), Some(1e-5)); // W m⁻² sr⁻¹ nm⁻¹
//! assert_eq!(Unit::parse("Angstrom")?.to_nm(5500.0), Some(550.0));
//! assert!(Unit::parse("W/m^2")?.radiance().is_none());
//! assert!(Unit::parse("furlongs").is_err());
//! # Ok::<(), camrig_base::Error>(())
//! ```

use crate::{Error, Result};

/// What a dimension is a product of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Base {
    /// m, of areas.
    Length,
    /// nm, of light.
    Wavelength,
    /// 1/cm.
    Wavenumber,
    /// Hz.
    Frequency,
    /// eV, of a photon.
    PhotonEnergy,
    /// s.
    Time,
    /// J.
    Energy,
    /// A.
    Current,
    /// V.
    Voltage,
    /// lm.
    Luminous,
    /// sr.
    SolidAngle,
    /// Photons.
    Photon,
    /// mol.
    Amount,
    /// Electrons.
    Electron,
    /// Digital numbers.
    Count,
}

const BASES: usize = Base::Count as usize + 1;
const PER_CENT: &str = "per cent";

type Dimension = [i32; BASES];

/// A unit: a factor and a dimension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    mantissa: f64,
    /// Power of ten that the mantissa is multiplied by, so that decimal factors are exact.
    exponent: i32,
    dimension: Dimension,
}

/// Speed of light, m/s (exact by the SI's definition of the metre).
const LIGHT_M_PER_S: f64 = 299_792_458.0;
/// Energy of a photon times its wavelength, eV·nm: hc (CODATA 2018); e⁻ per photon over A/W at 1 nm
/// is the same number.
pub(crate) const PHOTON_EV_NM: f64 = 1_239.841_984;
/// Powers of a unit beyond which a text is no unit.
const MAX_POWER: i32 = 30;
/// Characters of a unit beyond which a text is none.
const MAX_LENGTH: usize = 100;

/// A unit's symbol, its factor as mantissa and power of ten, and its dimension.
type Symbol = (&'static str, f64, i32, &'static [(Base, i32)]);

/// Symbols that take the prefixes of the SI.
const PREFIXED: [Symbol; 15] = [
    ("m", 1.0, 0, &[(Base::Length, 1)]),
    ("s", 1.0, 0, &[(Base::Time, 1)]),
    ("J", 1.0, 0, &[(Base::Energy, 1)]),
    ("W", 1.0, 0, &[(Base::Energy, 1), (Base::Time, -1)]),
    ("A", 1.0, 0, &[(Base::Current, 1)]),
    ("V", 1.0, 0, &[(Base::Voltage, 1)]),
    ("Hz", 1.0, 0, &[(Base::Frequency, 1)]),
    ("eV", 1.0, 0, &[(Base::PhotonEnergy, 1)]),
    ("sr", 1.0, 0, &[(Base::SolidAngle, 1)]),
    ("lm", 1.0, 0, &[(Base::Luminous, 1)]),
    ("cd", 1.0, 0, &[(Base::Luminous, 1), (Base::SolidAngle, -1)]),
    ("lx", 1.0, 0, &[(Base::Luminous, 1), (Base::Length, -2)]),
    ("mol", 1.0, 0, &[(Base::Amount, 1)]),
    // Einstein, a mole of photons.
    ("E", 1.0, 0, &[(Base::Amount, 1)]),
    ("Jy", 1.0, -26, JANSKY),
];

const JANSKY: &[(Base, i32)] =
    &[(Base::Energy, 1), (Base::Time, -1), (Base::Length, -2), (Base::Frequency, -1)];

/// Symbols without prefixes.
const WHOLE: [Symbol; 23] = [
    ("nm", 1.0, 0, &[(Base::Wavelength, 1)]),
    ("um", 1.0, 3, &[(Base::Wavelength, 1)]),
    ("µm", 1.0, 3, &[(Base::Wavelength, 1)]),
    ("Å", 1.0, -1, &[(Base::Wavelength, 1)]),
    ("micron", 1.0, 3, &[(Base::Wavelength, 1)]),
    ("microns", 1.0, 3, &[(Base::Wavelength, 1)]),
    ("wavenumber", 1.0, 0, &[(Base::Wavenumber, 1)]),
    ("wavenumbers", 1.0, 0, &[(Base::Wavenumber, 1)]),
    ("kayser", 1.0, 0, &[(Base::Wavenumber, 1)]),
    ("sec", 1.0, 0, &[(Base::Time, 1)]),
    ("erg", 1.0, -7, &[(Base::Energy, 1)]),
    ("ph", 1.0, 0, &[(Base::Photon, 1)]),
    ("quanta", 1.0, 0, &[(Base::Photon, 1)]),
    ("e-", 1.0, 0, &[(Base::Electron, 1)]),
    ("DN", 1.0, 0, &[(Base::Count, 1)]),
    ("ADU", 1.0, 0, &[(Base::Count, 1)]),
    ("LSB", 1.0, 0, &[(Base::Count, 1)]),
    ("%", 1.0, -2, &[]),
    ("‰", 1.0, -3, &[]),
    ("ppm", 1.0, -6, &[]),
    ("unitless", 1.0, 0, &[]),
    ("dimensionless", 1.0, 0, &[]),
    ("fraction", 1.0, 0, &[]),
];

/// Names, which also end with s, and the symbols that they stand for.
const NAMES: [(&str, &str); 30] = [
    ("meter", "m"),
    ("metre", "m"),
    ("nanometer", "nm"),
    ("nanometre", "nm"),
    ("micrometer", "um"),
    ("micrometre", "um"),
    ("angstrom", "Å"),
    ("ångström", "Å"),
    ("second", "s"),
    ("joule", "J"),
    ("erg", "erg"),
    ("watt", "W"),
    ("ampere", "A"),
    ("amp", "A"),
    ("volt", "V"),
    ("hertz", "Hz"),
    ("electronvolt", "eV"),
    ("steradian", "sr"),
    ("lumen", "lm"),
    ("candela", "cd"),
    ("lux", "lx"),
    ("mole", "mol"),
    ("einstein", "E"),
    ("jansky", "Jy"),
    ("photon", "ph"),
    ("electron", "e-"),
    ("count", "DN"),
    ("percent", "%"),
    ("pct", "%"),
    ("permille", "‰"),
];

/// Prefixes by letter and by name, with their power of ten.
const PREFIXES: [(&str, &str, i32); 11] = [
    ("p", "pico", -12),
    ("n", "nano", -9),
    ("u", "micro", -6),
    ("µ", "micro", -6),
    ("m", "milli", -3),
    ("c", "centi", -2),
    ("k", "kilo", 3),
    ("M", "mega", 6),
    ("G", "giga", 9),
    ("T", "tera", 12),
    ("P", "peta", 15),
];

impl Unit {
    const ONE: Self = Self { mantissa: 1.0, exponent: 0, dimension: [0; BASES] };

    /// The unit that a text names; an empty text is 1.
    ///
    /// # Errors
    /// A text that is not understood.
    pub fn parse(text: &str) -> Result<Self> {
        let characters = plain(text);
        let understood = |is_folded| {
            if characters.len() > MAX_LENGTH {
                return None;
            }
            if characters == ['-'] {
                return Some(Self::ONE);
            }
            let mut parser = Parser { characters: &characters, at: 0, is_folded };
            let unit = parser.product(false)?;
            (parser.at == characters.len()).then_some(unit)
        };
        understood(false)
            .or_else(|| understood(true))
            .filter(|unit| unit.factor().is_finite() && unit.factor() > 0.0)
            .ok_or_else(|| Error::input(format!("the unit {text:?} is not understood")))
    }

    /// How many units of the dimension it is.
    pub fn factor(&self) -> f64 {
        self.of(1.0)
    }

    /// A value in this unit, in units of the dimension: in m, nm, 1/cm, Hz, eV, s, J, A, V, lm, sr.
    pub fn of(&self, value: f64) -> f64 {
        let power = libm::pow(10.0, f64::from(self.exponent.abs()));
        let value = value * self.mantissa;
        if self.exponent < 0 { value / power } else { value * power }
    }

    /// Whether it is a number.
    pub fn is_dimensionless(&self) -> bool {
        self.dimension == [0; BASES]
    }

    /// The power of a base.
    pub(crate) fn power(&self, base: Base) -> i32 {
        self.dimension[base as usize]
    }

    /// Whether it is the product of these powers and of nothing else.
    pub(crate) fn is(&self, powers: &[(Base, i32)]) -> bool {
        self.dimension == dimension(powers)
    }

    /// What radiance of this unit is multiplied by to be in W m⁻² sr⁻¹ nm⁻¹; `None` where it is no
    /// unit of radiance per wavelength.
    pub fn radiance(&self) -> Option<f64> {
        use Base::{Energy, Length, SolidAngle, Time, Wavelength};
        let per = |length, wavelength| {
            let light = [(Energy, 1), (Time, -1), (SolidAngle, -1)];
            self.is(&[&light[..], &[(Length, length), (Wavelength, wavelength)]].concat())
        };
        // W m⁻³ sr⁻¹: the CF conventions have wavelengths in m.
        let of_metres = per(-3, 0).then(|| self.with_exponent(-9).factor());
        per(-2, -1).then(|| self.factor()).or(of_metres)
    }

    /// A wavelength, wavenumber, frequency or photon energy of this unit as a wavelength in nm;
    /// `None` where it is a unit of none.
    pub fn to_nm(&self, value: f64) -> Option<f64> {
        let is = |base, power| self.is(&[(base, power)]);
        if is(Base::Wavelength, 1) {
            Some(self.of(value))
        } else if is(Base::Length, 1) {
            Some(self.with_exponent(9).of(value))
        } else if is(Base::Wavenumber, 1) {
            Some(1e7 / self.of(value))
        } else if is(Base::Length, -1) {
            Some(1e7 / self.with_exponent(-2).of(value))
        } else if is(Base::Frequency, 1) {
            Some(LIGHT_M_PER_S / self.with_exponent(-9).of(value))
        } else if is(Base::PhotonEnergy, 1) {
            Some(PHOTON_EV_NM / self.of(value))
        } else {
            None
        }
    }

    /// How many seconds it is; `None` where it is no unit of time.
    pub fn seconds(&self) -> Option<f64> {
        self.is(&[(Base::Time, 1)]).then(|| self.factor())
    }

    /// The unit times a power of ten.
    fn with_exponent(self, exponent: i32) -> Self {
        Self { exponent: self.exponent + exponent, ..self }
    }

    fn times(self, other: Self) -> Self {
        let sum = |i: usize| self.dimension[i] + other.dimension[i];
        Self {
            mantissa: self.mantissa * other.mantissa,
            exponent: self.exponent + other.exponent,
            dimension: std::array::from_fn(sum),
        }
    }

    fn raised(self, power: i32) -> Self {
        Self {
            mantissa: libm::pow(self.mantissa, f64::from(power)),
            exponent: self.exponent * power,
            dimension: self.dimension.map(|of| of * power),
        }
    }
}

fn dimension(powers: &[(Base, i32)]) -> Dimension {
    let mut dimension = [0; BASES];
    powers.iter().for_each(|&(base, power)| dimension[base as usize] += power);
    dimension
}

/// The characters of a unit, superscripts as powers.
fn plain(text: &str) -> Vec<char> {
    const SUPERSCRIPTS: &str = "⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻";
    let mut plain = Vec::new();
    let mut is_raised = false;
    // As labels of plots have it.
    let text = text.replace("\\mu ", "µ").replace("\\mu", "µ");
    for c in text.trim().chars() {
        let superscript = SUPERSCRIPTS.chars().position(|of| of == c);
        if superscript.is_some() && !is_raised {
            plain.push('^');
        }
        is_raised = superscript.is_some();
        match superscript {
            Some(i) => plain.extend("0123456789+-".chars().nth(i)),
            None => plain.push(match c {
                'μ' => 'µ',
                '\u{212b}' => 'Å',
                '−' | '–' => '-',
                '·' | '⋅' | '×' => '*',
                '[' => '(',
                ']' => ')',
                _ => c,
            }),
        }
    }
    plain
}

struct Parser<'a> {
    characters: &'a [char],
    at: usize,
    /// Whether letter case is ignored.
    is_folded: bool,
}

impl Parser<'_> {
    fn peek(&self, ahead: usize) -> Option<char> {
        self.characters.get(self.at + ahead).copied()
    }

    /// Whether the next character is `c`, which is then taken.
    fn takes(&mut self, c: char) -> bool {
        let is_next = self.peek(0) == Some(c);
        self.at += usize::from(is_next);
        is_next
    }

    /// Whether a word of small letters begins here, in letters of any case.
    fn begins(&self, word: &str) -> bool {
        let rest = &self.characters[self.at..];
        word.chars()
            .enumerate()
            .all(|(i, c)| rest.get(i).is_some_and(|r| r.to_ascii_lowercase() == c))
    }

    fn skip_blanks(&mut self) {
        while self.peek(0).is_some_and(char::is_whitespace) {
            self.at += 1;
        }
    }

    /// The characters from here that are `of` a kind.
    fn take(&mut self, of: impl Fn(char) -> bool) -> String {
        let taken: String = self.characters[self.at..].iter().take_while(|c| of(**c)).collect();
        self.at += taken.chars().count();
        taken
    }

    /// Terms up to the end or a closing bracket; whether what is made of them is divided by.
    fn product(&mut self, is_divisor: bool) -> Option<Unit> {
        let mut unit = Unit::ONE;
        self.skip_blanks();
        let mut is_first = true;
        while let Some(next) = self.peek(0).filter(|c| *c != ')') {
            let is_per = self.begins("per ") && !self.begins(PER_CENT);
            let divides = next == '/' || is_per;
            if is_per {
                self.at += "per ".len();
            } else if divides || !is_first && matches!(next, '*' | '.') {
                self.at += 1;
            }
            self.skip_blanks();
            let term = self.term(is_divisor != divides)?;
            unit = unit.times(if divides { term.raised(-1) } else { term });
            if unit.dimension.iter().any(|power| power.abs() > MAX_POWER)
                || unit.exponent.abs() > 300
            {
                return None;
            }
            is_first = false;
            self.skip_blanks();
        }
        Some(unit)
    }

    fn term(&mut self, is_divisor: bool) -> Option<Unit> {
        if self.peek(0)?.is_ascii_digit() {
            return self.number();
        }
        if self.begins(PER_CENT) {
            self.at += PER_CENT.len();
            return find(&WHOLE, "%", false);
        }
        if self.peek(0) == Some('(') {
            let start = self.at;
            let unit = self.group(is_divisor)?;
            let power = self.power()?;
            if power >= 0 {
                return Some(unit.raised(power));
            }
            let end = std::mem::replace(&mut self.at, start);
            let unit = self.group(!is_divisor)?;
            self.at = end;
            return Some(unit.raised(power));
        }
        for (word, power) in [("square ", 2), ("sq. ", 2), ("sq ", 2), ("cubic ", 3)] {
            if self.begins(word) {
                self.at += word.len();
                self.skip_blanks();
                return Some(self.term(false)?.raised(power));
            }
        }
        let is_mark = |c| matches!(c, '%' | '‰');
        let mut symbol = match self.peek(0).filter(|c| is_mark(*c)) {
            Some(_) => self.take(is_mark),
            None => self.take(char::is_alphabetic),
        };
        // e⁻ in any spelling, and not a power of e.
        let skipped = usize::from(self.peek(0) == Some('^'));
        let is_signed = self.peek(skipped) == Some('-');
        if symbol == "e"
            && is_signed
            && !self.peek(skipped + 1).is_some_and(|c| c.is_ascii_digit())
        {
            self.at += skipped + 1;
            symbol.push('-');
        }
        let (last, before) = self.symbols(&symbol)?;
        let last = match self.power()? {
            // cm⁻¹ that is divided by is a wavenumber: another dimension than cm that is not.
            -1 if is_divisor && last.is(&[(Base::Length, 1)]) => {
                let per_cm = last.raised(-1).with_exponent(-2);
                Unit { dimension: dimension(&[(Base::Wavenumber, 1)]), ..per_cm }
            }
            power => last.raised(power),
        };
        Some(before.times(last))
    }

    /// What brackets hold.
    fn group(&mut self, is_divisor: bool) -> Option<Unit> {
        self.at += 1;
        let unit = self.product(is_divisor)?;
        self.takes(')').then_some(unit)
    }

    /// The power that follows, 1 where none does; `None` for a mark of one without a number.
    fn power(&mut self) -> Option<i32> {
        let is_digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
        let mut is_marked = self.takes('^');
        if !is_marked && self.peek(0) == Some('*') && self.peek(1) == Some('*') {
            self.at += 2;
            is_marked = true;
        }
        let in_braces = is_marked && self.takes('{');
        let is_signed = matches!(self.peek(0), Some('-' | '+')) && is_digit(self.peek(1));
        if !is_signed && !is_digit(self.peek(0)) {
            return (!is_marked).then_some(1);
        }
        let sign = if is_signed && self.peek(0) == Some('-') { -1 } else { 1 };
        self.at += usize::from(is_signed);
        let power: i32 = self.take(|c| c.is_ascii_digit()).parse().ok()?;
        let is_closed = !in_braces || self.takes('}');
        (is_closed && power <= MAX_POWER).then_some(sign * power)
    }

    /// A number such as `10`, `1e-3` or `10^-3`.
    fn number(&mut self) -> Option<Unit> {
        let is_digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
        let mut text = self.take(|c| c.is_ascii_digit());
        if self.peek(0) == Some('.') && is_digit(self.peek(1)) {
            self.at += 1;
            text = format!("{text}.{}", self.take(|c| c.is_ascii_digit()));
        }
        let is_signed = matches!(self.peek(1), Some('-' | '+'));
        if matches!(self.peek(0), Some('e' | 'E'))
            && is_digit(self.peek(1 + usize::from(is_signed)))
        {
            let sign: String = self.peek(1).filter(|_| is_signed).into_iter().collect();
            self.at += 1 + usize::from(is_signed);
            text = format!("{text}e{sign}{}", self.take(|c| c.is_ascii_digit()));
        }
        let number: f64 = text.parse().ok()?;
        // Digits before a sign are no power of the number: `10-3`.
        let power = if self.peek(0) == Some('-') { return None } else { self.power()? };
        Some(match number {
            10.0 => Unit::ONE.with_exponent(power),
            _ => Unit { mantissa: libm::pow(number, f64::from(power)), ..Unit::ONE },
        })
    }

    /// The unit of a symbol or name; or of two that are written as one, as in `mAW-1`, where only
    /// one division of the letters gives two: the last, which a power belongs to, and the other.
    fn symbols(&self, text: &str) -> Option<(Unit, Unit)> {
        if let Some(unit) = self.symbol(text) {
            return Some((unit, Unit::ONE));
        }
        let pair = |(at, _): (usize, char)| {
            let (before, last) = text.split_at(at);
            Some((self.symbol(last)?, self.symbol(before)?))
        };
        let mut pairs = text.char_indices().skip(1).filter_map(pair);
        pairs.next().filter(|_| !self.is_folded && pairs.next().is_none())
    }

    fn symbol(&self, text: &str) -> Option<Unit> {
        let whole = find(&WHOLE, text, self.is_folded);
        whole.or_else(|| self.prefixed(text)).or_else(|| named(&text.to_lowercase()))
    }

    fn prefixed(&self, text: &str) -> Option<Unit> {
        if let Some(unit) = find(&PREFIXED, text, self.is_folded) {
            return Some(unit);
        }
        PREFIXES.iter().find_map(|(letter, name, exponent)| {
            let by_letter = match self.is_folded {
                // Mega or milli, peta or pico.
                true if text.starts_with(['M', 'P']) => None,
                true => text.get(letter.len()..).filter(|_| folds(&text[..letter.len()], letter)),
                false => text.strip_prefix(letter),
            };
            // `microW`: the name of a prefix and a symbol.
            let rests = [by_letter, text.strip_prefix(name)].into_iter().flatten();
            let unit = rests.filter_map(|rest| find(&PREFIXED, rest, self.is_folded)).next()?;
            Some(unit.with_exponent(*exponent))
        })
    }
}

/// The unit of a name, with the name of a prefix or without: `watts`, `microwatt`.
fn named(text: &str) -> Option<Unit> {
    let of = |text: &str| {
        let single = text.strip_suffix('s').unwrap_or(text);
        let (_, symbol) = NAMES.iter().find(|(name, _)| *name == text || *name == single)?;
        find(&WHOLE, symbol, false).or_else(|| find(&PREFIXED, symbol, false))
    };
    of(text).or_else(|| {
        let prefixed = |(_, prefix, exponent): &(&str, &str, i32)| {
            Some(of(text.strip_prefix(prefix)?)?.with_exponent(*exponent))
        };
        PREFIXES.iter().find_map(prefixed)
    })
}

fn find(symbols: &[Symbol], text: &str, is_folded: bool) -> Option<Unit> {
    let same = |name: &str| name == text || is_folded && folds(name, text);
    let (_, mantissa, exponent, powers) = symbols.iter().find(|(name, ..)| same(name))?;
    Some(Unit { mantissa: *mantissa, exponent: *exponent, dimension: dimension(powers) })
}

/// Whether two texts are the same but for letter case.
fn folds(one: &str, other: &str) -> bool {
    one.to_lowercase() == other.to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: f64, b: f64) -> bool {
        (a / b - 1.0).abs() < 1e-12
    }

    /// 1 mW/cm² is 10 W/m², and 1 /µm is 0.001 /nm.
    #[test]
    fn radiance_is_understood_in_any_spelling() {
        for (unit, factor) in [
            ("W.m^-2.sr^-1.nm^-1", 1.0),
            ("mW.m^-2.sr^-1.nm^-1", 1e-3),
            ("W m-2 sr-1 um-1", 1e-3),
            ("µW/cm^2/sr/nm", 1e-2),
            ("μW cm^-2 sr^-1 nm^-1", 1e-2),
            ("uW/cm^2/SR/nm", 1e-2),
            ("mW/(cm² sr µm)", 1e-2),
            ("W·m⁻²·sr⁻¹·nm⁻¹", 1.0),
            ("W m^{-2} sr^{-1} nm^{-1}", 1.0),
            ("Wm-2sr-1nm-1", 1.0),
            ("w/m2/sr/nm", 1.0),
            ("W/(m2.sr.um)", 1e-3),
            ("W/m**2/sr/nm", 1.0),
            ("(W m-2) sr-1 (nm)^-1", 1.0),
            ("Watts/meter^2/steradian/micrometer", 1e-3),
            ("watts per metre^2 per steradian per micron", 1e-3),
            ("microwatt/cm^2/sr/nm", 1e-2),
            ("microW/cm^2/nm/sr", 1e-2),
            ("UW/CM^2/SR/NM", 1e-2),
            ("10*uW/cm^2/sr/nm", 0.1),
            ("1e-3 W/m2/sr/nm", 1e-3),
            ("10^-3 W/m2/sr/nm", 1e-3),
            ("10⁻³ W/m²/sr/nm", 1e-3),
            ("erg/s/cm^2/sr/nm", 1e-3),
            ("ergs s-1 cm-2 sr-1 nm-1", 1e-3),
            ("Watts per square metre per steradian per micrometre", 1e-3),
            ("microwatts per square centimeter per steradian per nanometer", 1e-2),
            ("W m^{-2} sr^{-1} \\mu m^{-1}", 1e-3),
            ("W m-2 sr-1 Å-1", 10.0),
            ("W m-3 sr-1", 1e-9),
        ] {
            let found = Unit::parse(unit).unwrap_or_else(|e| panic!("{e}")).radiance();
            assert!(found.is_some_and(|found| near(found, factor)), "{unit}: {found:?}");
        }
    }

    #[test]
    fn units_of_other_dimensions_are_no_radiance() {
        for unit in [
            "W.m^-2.sr^-1",
            "W.m^-2.nm^-1",
            "W.m^2.sr^-1.nm^-1",
            "W.m^-2.sr^-1.nm^-1.nm^-1",
            // From left to right: sr and nm are multiplied by.
            "W/m2 sr nm",
            "W/m2/sr/cm-1",
            "W m-2 sr-1 (cm-1)-1",
            "photons/s/m^2/sr/nm",
            "DN",
            "%",
            "",
        ] {
            assert_eq!(Unit::parse(unit).unwrap().radiance(), None, "{unit}");
        }
    }

    #[test]
    fn what_is_not_understood_is_refused() {
        for unit in [
            "furlongs",
            "W//m2",
            "W/",
            "(W",
            "W)",
            "m^",
            "10-3",
            "*W",
            "arb. units",
            "W/m^x",
            "+/- 5%",
            // Mega or milli, where other letters are in capitals that are not the unit's.
            "MW/CM2",
            "m999",
            "1e999",
            "0 W",
        ] {
            assert!(Unit::parse(unit).is_err(), "{unit}: {:?}", Unit::parse(unit));
        }
        assert!(Unit::parse(&"m ".repeat(200)).is_err());
    }

    #[test]
    fn wavelengths_are_in_nm() {
        for (unit, value) in [
            ("nm", 500.0),
            ("Nanometers", 500.0),
            ("um", 0.5),
            ("Micrometers", 0.5),
            ("microns", 0.5),
            ("Angstroms", 5000.0),
            ("m", 5e-7),
            ("cm-1", 20_000.0),
            ("1/cm", 20_000.0),
            ("Wavenumber", 20_000.0),
            ("GHz", 599_584.916),
            ("THz", 599.584_916),
            ("eV", 2.479_683_968),
        ] {
            let nm = Unit::parse(unit).unwrap().to_nm(value);
            assert!(nm.is_some_and(|nm| near(nm, 500.0)), "{unit}: {nm:?}");
        }
        assert_eq!(Unit::parse("W").unwrap().to_nm(1.0), None);
    }

    #[test]
    fn dimensions_of_light_are_told_apart() {
        use Base::{Amount, Current, Electron, Energy, Length, Photon, Time, Wavenumber};
        let watt = [(Energy, 1), (Time, -1)];
        for (unit, factor, powers) in [
            ("A/W", 1.0, &[(Current, 1), (Energy, -1), (Time, 1)][..]),
            ("mAW-1", 1e-3, &[(Current, 1), (Energy, -1), (Time, 1)]),
            ("e-/photon", 1.0, &[(Electron, 1), (Photon, -1)]),
            ("e⁻ per photon", 1.0, &[(Electron, 1), (Photon, -1)]),
            ("photons/s", 1.0, &[(Photon, 1), (Time, -1)]),
            ("umol m-2 s-1", 1e-6, &[(Amount, 1), (Length, -2), (Time, -1)]),
            ("W/cm-1", 1.0, &[watt[0], watt[1], (Wavenumber, -1)]),
            ("W (cm⁻¹)⁻¹", 1.0, &[watt[0], watt[1], (Wavenumber, -1)]),
            ("per cent", 0.01, &[]),
            ("%", 0.01, &[]),
            ("‰", 1e-3, &[]),
            ("1", 1.0, &[]),
            ("-", 1.0, &[]),
            ("unitless", 1.0, &[]),
        ] {
            let found = Unit::parse(unit).unwrap_or_else(|e| panic!("{e}"));
            assert!(found.is(powers) && near(found.factor(), factor), "{unit}: {found:?}");
        }
        assert_eq!(Unit::parse("%").unwrap().of(7.0), 7.0 / 100.0, "decimal factors are exact");
    }

    /// A unit written from its parts has the product of their factors, in any order and with any
    /// marks between them.
    #[test]
    fn a_product_is_that_of_its_parts() {
        let parts: [(&str, f64, i32); 4] =
            [("mW", 1e-3, 1), ("cm", 1e-2, -2), ("sr", 1.0, -1), ("µm", 1e3, -1)];
        let expected: f64 =
            parts.iter().map(|(_, factor, power)| libm::pow(*factor, f64::from(*power))).product();
        for turn in 0..4 {
            for between in [" ", ".", "*", "·", " · "] {
                let mut parts = parts;
                parts.rotate_left(turn);
                let words = parts.map(|(name, _, power)| format!("{name}^{power}"));
                let found = Unit::parse(&words.join(between)).unwrap();
                assert!(found.radiance().is_some_and(|f| near(f, expected)), "{words:?}");
            }
        }
    }

    /// No text makes the parser panic.
    #[test]
    fn damage_is_survived() {
        let text = "10*µW/(cm² sr Å)/e⁻ per cent";
        for (i, _) in text.char_indices() {
            for piece in ["", "(", ")", "/", "^", "-", "⁻", "{", "*", "e", "M", "İ", "9", "."] {
                for text in
                    [&format!("{}{piece}{}", &text[..i], &text[i..]), &text[..i], &text[i..]]
                {
                    let _ = Unit::parse(text);
                }
            }
        }
    }
}
