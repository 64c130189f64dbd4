//! The words of a column's header and the units among them.

/// Prefixes of units, in letters of one case: M is m, and mega is written with Hz alone.
const PREFIXES: [(&str, f64); 10] = [
    ("", 1.0),
    ("m", 1e-3),
    ("u", 1e-6),
    ("µ", 1e-6),
    ("n", 1e-9),
    ("p", 1e-12),
    ("k", 1e3),
    ("milli", 1e-3),
    ("micro", 1e-6),
    ("nano", 1e-9),
];
/// Words of the column of wavelengths, which stand before the others in a header that is not
/// divided into columns.
const WAVELENGTH: [&str; 10] =
    ["wavelength", "wavelengths", "wave", "length", "wl", "lambda", "λ", "nm", "µm", "um"];
const AMPERE: [&str; 5] = ["a", "amp", "amps", "ampere", "amperes"];
const WATT: [&str; 3] = ["w", "watt", "watts"];
const MOLE: [&str; 5] = ["mol", "mole", "moles", "einstein", "einsteins"];
const LUX: [&str; 2] = ["lx", "lux"];
const LUMEN: [&str; 5] = ["lm", "lumen", "lumens", "cd", "candela"];
const TRANSMITTANCE: [&str; 8] =
    ["t", "%t", "t%", "trans", "transmittance", "transmission", "transmissivity", "throughput"];
const REFLECTANCE: [&str; 6] = ["%r", "r%", "refl", "reflectance", "reflectivity", "reflection"];
const EFFICIENCY: [&str; 2] = ["qe", "efficiency"];
/// Words of wavelength and frequency that values may be multiplied by.
const LIGHT: [&str; 6] = ["lambda", "λ", "wavelength", "nu", "ν", "frequency"];
/// Signs of a product, beside letters.
const TIMES: [char; 4] = ['*', '×', '·', '⋅'];
/// What follows the name of values on another scale: `T (‰)`, `T (10^-3)`.
const SCALES: [&str; 7] = ["‰", "‱", "10^", "10⁻", "10²", "10³", "10⁶"];
/// Photons in a mole.
const MOLE_PHOTONS: f64 = 6.022_140_76e23;
/// Times a power per Hz over the square of the wavelength in nm it is a power per nm: c in nm/s.
const LIGHT_NM_PER_S: f64 = 2.997_924_58e17;
/// The same of a power per 1/cm: nm in a cm.
const CM_NM: f64 = 1e7;
/// The same of a power per eV: hc in eV·nm (CODATA 2018).
const PHOTON_EV_NM: f64 = 1_239.841_984;
/// Absorbance on the scale of natural logarithms in absorbance: log10 e.
const NAPIERIAN: f64 = std::f64::consts::LOG10_E;

/// A word of a header: letters, digits and `%`.
struct Word {
    /// In small letters, without the power.
    text: String,
    /// As it stands, with the power.
    whole: String,
    /// The power that a unit is raised to, as in `cm-1`, `cm^-1` and `cm⁻¹`.
    power: Option<i32>,
    /// Whether it stands under a stroke or behind `per`.
    below: bool,
    /// How many brackets are open.
    depth: usize,
    /// The mark before it, if one stands between it and the word before.
    before: Option<char>,
    /// The character behind it.
    after: Option<char>,
}

impl Word {
    fn is(&self, names: &[&str]) -> bool {
        names.contains(&&self.text[..])
    }

    /// The prefix, as a number, with which it is one of these units.
    fn prefix(&self, units: &[&str]) -> Option<f64> {
        let scale = |unit: &&str| {
            let prefix = self.text.strip_suffix(unit)?;
            PREFIXES.iter().find(|(name, _)| *name == prefix).map(|(_, scale)| *scale)
        };
        units.iter().find_map(scale)
    }

    /// Whether it is a unit that others are divided by.
    fn divides(&self) -> bool {
        self.below || self.power.is_some_and(|power| power < 0)
    }

    fn is_number(&self) -> bool {
        self.text.chars().all(|c| c.is_ascii_digit())
    }

    /// A word without a power and of nothing but text.
    fn of(whole: &str) -> Self {
        let text = whole.to_lowercase();
        let digits = text.trim_end_matches(|c: char| c.is_ascii_digit());
        let power = match digits.is_empty() {
            true => None,
            false => text[digits.len()..].parse().ok(),
        };
        let text = if power.is_some() { digits.to_string() } else { text };
        let whole = whole.to_string();
        Self { text, whole, power, below: false, depth: 0, before: None, after: None }
    }
}

/// The words of a column's header.
pub struct Header {
    words: Vec<Word>,
    /// Whether one of them is a mark of another scale.
    is_marked: bool,
    /// Whether the values are multiplied by their wavelength or frequency.
    is_times_light: bool,
}

impl Header {
    /// The words of a header.
    pub fn of(header: &str) -> Self {
        let plain = |c: char| match c {
            '⁻' | '−' | '–' => Some('-'),
            '⁰' | '₀' => Some('0'),
            '¹' | '₁' => Some('1'),
            '²' => Some('2'),
            '³' => Some('3'),
            'μ' => Some('µ'),
            '^' | '{' | '}' => None,
            _ => Some(c),
        };
        let text: Vec<char> = header.chars().filter_map(plain).collect();
        let in_word = |i: usize| text.get(i).is_some_and(|c| c.is_alphanumeric() || *c == '%');
        let digit = |i: usize| text.get(i).is_some_and(char::is_ascii_digit);
        // Whether what follows is divided by, in each open bracket; what the last mark was.
        let (mut below, mut divides, mut before) = (vec![false], false, None);
        let (mut words, mut i) = (Vec::<Word>::new(), 0);
        while i < text.len() {
            if !in_word(i) {
                match text[i] {
                    '/' => {
                        divides = true;
                        *below.last_mut().expect("one level stays") = true;
                    }
                    '(' | '[' => below.push(divides),
                    ')' | ']' if below.len() > 1 => {
                        below.pop();
                    }
                    _ => {}
                }
                before = if text[i].is_whitespace() { before } else { Some(text[i]) };
                i += 1;
                continue;
            }
            let start = i;
            while in_word(i) {
                i += 1;
            }
            let mut word = Word::of(&text[start..i].iter().collect::<String>());
            if text.get(i) == Some(&'-') && digit(i + 1) && !word.is_number() {
                let sign = i;
                i += 1;
                while digit(i) {
                    i += 1;
                }
                word.whole = text[start..i].iter().collect();
                word.power = text[sign..i].iter().collect::<String>().parse().ok();
            }
            let per = word.is(&["per"]);
            if per {
                *below.last_mut().expect("one level stays") = true;
            } else {
                let within = *below.last().expect("one level stays");
                words.push(Word {
                    below: within,
                    depth: below.len() - 1,
                    before,
                    after: text.get(i).copied(),
                    ..word
                });
            }
            (divides, before) = (per, None);
        }
        let times = |mark: Option<char>| mark.is_some_and(|mark| TIMES.contains(&mark));
        let light = |word: &Word| word.is(&LIGHT) && (times(word.before) || times(word.after));
        let is_times_light = words.iter().any(light);
        let of_wavelength = words.iter().take_while(|word| word.is(&WAVELENGTH)).count();
        words.drain(..of_wavelength);
        let is_marked = SCALES.iter().any(|mark| header.contains(mark));
        Self { words, is_marked, is_times_light }
    }

    /// Whether the values are written on a scale of their own: in parts per thousand or million,
    /// or times a power of ten, as in `T (‰)`, `T*1000` and `T (x10^-2)`.
    pub fn is_scaled(&self) -> bool {
        let parts = ["ppm", "ppb", "permil", "permill", "permille", "promille", "mille"];
        let ten = |word: &Word| word.is_number() && word.text.starts_with("10");
        let joined = |word: &Word| {
            let times = word.whole.strip_prefix(['x', 'X']).is_some_and(|n| n.starts_with("10"));
            times || word.depth > 0 && word.text == "1e"
        };
        let product = |i: usize| {
            let sign = self.words[i].before.is_some_and(|mark| TIMES.contains(&mark));
            let said = i > 0 && self.words[i - 1].is(&["x", "times"]);
            // A number before the sign makes a size of it, as in `10 x 10 mm`.
            let of = i.checked_sub(if sign { 1 } else { 2 });
            ten(&self.words[i])
                && (sign || said)
                && of.is_none_or(|of| !self.words[of].is_number())
        };
        self.is_marked
            || self.has(&parts)
            || self.words.iter().skip(1).any(joined)
            || (0..self.words.len()).any(product)
    }

    /// Whether the values are what a quantity leaves of the whole, or its inverse: `1-T`, `1/T`.
    pub fn is_complement(&self) -> bool {
        let names = [&TRANSMITTANCE[..], &REFLECTANCE, &EFFICIENCY, &["r"]].concat();
        let of_whole = |(whole, name): (&Word, &Word)| {
            ["1", "100"].contains(&&whole.text[..])
                && matches!(name.before, Some('-' | '/'))
                && name.is(&names)
        };
        !self.has(&["log", "lg", "ln"]) && self.pairs().any(of_whole)
    }

    /// Whether the values are multiplied by wavelength or frequency, as in `λI(λ)`.
    pub fn is_times_light(&self) -> bool {
        self.is_times_light || self.has(&["λi", "λe", "λf", "λl", "λp", "νfν", "νf", "nufnu"])
    }

    fn has(&self, names: &[&str]) -> bool {
        self.words.iter().any(|word| word.is(names))
    }

    fn starts(&self, names: &[&str]) -> bool {
        self.words.first().is_some_and(|word| word.is(names))
    }

    /// Each word with the one behind it.
    fn pairs(&self) -> impl Iterator<Item = (&Word, &Word)> {
        self.words.iter().zip(self.words.iter().skip(1))
    }

    /// Whether a number stands before a word, as in `100 Hz`: a size, not a unit of the values.
    fn is_size(&self, index: usize) -> bool {
        let before = index.checked_sub(1).map(|i| &self.words[i]);
        before.is_some_and(|word| word.is_number() && word.after.is_some_and(char::is_whitespace))
    }

    /// Whether one of the units is among the words and `fits`.
    fn unit(&self, fits: impl Fn(&Word) -> bool) -> bool {
        self.words.iter().enumerate().any(|(i, word)| fits(word) && !self.is_size(i))
    }

    /// Whether the column's name, outside brackets, is one of these, in just these letters.
    fn is_named(&self, names: &[&str]) -> bool {
        let mut name = self.words.iter().filter(|word| word.depth == 0 && !word.is(&["%"]));
        let first = name.next().is_some_and(|word| names.contains(&&word.whole[..]));
        first && name.next().is_none()
    }

    /// Whether the values are per cent: `5%` is the size of an error.
    pub fn is_percent(&self) -> bool {
        let sized = |word: &Word| word.text.starts_with(|c: char| c.is_ascii_digit());
        self.has(&["percent", "pct", "percentage"])
            || self.words.iter().any(|word| word.below && word.is(&["cent"]))
            || self.words.iter().any(|word| word.text.contains('%') && !sized(word))
    }

    /// Whether it says of light that it is given in per cent.
    pub fn is_percent_of_light(&self) -> bool {
        let light = self.is_transmittance() || self.has(&REFLECTANCE) || self.has(&EFFICIENCY);
        light && self.is_percent()
    }

    /// Whether the values are relative to an unknown scale.
    pub fn is_relative(&self) -> bool {
        self.has(&["relative", "normalised", "normalized", "arb", "arbitrary", "rel"])
    }

    /// Whether the words say that light that gets through is meant.
    pub fn is_transmittance(&self) -> bool {
        self.has(&TRANSMITTANCE)
    }

    /// Whether they say that light that comes back is meant.
    pub fn is_reflectance(&self) -> bool {
        !self.is_transmittance()
            && (self.has(&REFLECTANCE) || self.is_named(&["R"]) && self.is_percent())
    }

    /// Whether they say that light that is lost is meant, and not on which scale.
    pub fn is_loss(&self) -> bool {
        !self.is_transmittance() && self.has(&["attenuation", "loss"])
    }

    /// Whether they say which fraction of light is absorbed: `Absorption (%)`.
    pub fn is_absorbed(&self) -> bool {
        self.has(&["absorptance", "absorbed"])
            || self.is_percent() && (self.is_absorbance_word() || self.is_named(&["A"]))
    }

    /// Whether they name a material's absorption per length or concentration.
    pub fn is_coefficient(&self) -> bool {
        let other = self.is_transmittance() || self.is_reflectance();
        self.has(&["absorptivity", "molar"])
            || self.unit(|word| word.prefix(&MOLE).is_some())
            || self.unit(|word| word.is(&["cm", "mm"]) && word.divides())
            || self.has(&["coefficient"]) && !other
    }

    fn is_absorbance_word(&self) -> bool {
        // `Abs.` before other quantities is short for absolute.
        let others = ["power", "irradiance", "radiance", "flux", "intensity", "qe", "quantum"];
        let absolute = self.has(&others) || self.has(&TRANSMITTANCE) || self.has(&REFLECTANCE);
        self.has(&["absorbance", "absorption"]) || self.starts(&["abs", "extinction"]) && !absolute
    }

    /// Absorbance or optical density, as so many absorbances.
    pub fn absorbance(&self) -> Option<f64> {
        let optical =
            |of: &[&str]| self.pairs().any(|(word, next)| word.is(&["optical"]) && next.is(of));
        let milli = |word: &Word| word.is(&["mau", "mabs"]) || word.whole == "mOD";
        let density = (0..self.words.len()).any(|i| self.is_od(i) && !self.is_rating(i));
        if self.unit(milli) {
            return Some(1e-3);
        }
        if optical(&["depth", "thickness"]) {
            return Some(NAPIERIAN);
        }
        let natural = self.has(&["napierian", "naperian", "neperian", "ln"]);
        (self.is_absorbance_word() || density || optical(&["density"])).then_some(if natural {
            NAPIERIAN
        } else {
            1.0
        })
    }

    /// Whether a filter's column is named as an instrument names its absorbance or density.
    pub fn is_named_density(&self) -> bool {
        let density = |words: &[Word]| match words {
            [first, ..] if first.is(&["density"]) => true,
            [first, next, ..] => {
                first.is(&["transmission", "transmittance"]) && next.is(&["density"])
            }
            _ => false,
        };
        self.is_named(&["A", "AU"]) && !self.is_transmittance() || density(&self.words)
    }

    /// Whether `OD` stands here, or `O.D.`.
    fn is_od(&self, i: usize) -> bool {
        let dotted = |word: &Word, next: &Word| {
            word.is(&["o"]) && next.is(&["d"]) && next.before == Some('.')
        };
        self.words[i].is(&["od"])
            || self.words.get(i + 1).is_some_and(|next| dotted(&self.words[i], next))
    }

    /// Whether the OD here is a filter's rating, as in `OD6 bandpass` and `OD > 4`.
    fn is_rating(&self, i: usize) -> bool {
        let last = if self.words[i].is(&["o"]) { i + 1 } else { i };
        let follows = |next: &Word| next.is_number() && next.depth == self.words[i].depth;
        self.words[last].power.is_some() || self.words.get(last + 1).is_some_and(follows)
    }

    /// Whether a filter's rating is all that its header says of the values.
    pub fn is_rating_alone(&self) -> bool {
        let od = |i| self.is_od(i) && self.is_rating(i);
        let neutral =
            || self.pairs().any(|(word, next)| word.is(&["neutral"]) && next.is(&["density"]));
        !self.is_transmittance()
            && !self.is_percent()
            && (self.has(&["nd"]) || neutral() || (0..self.words.len()).any(od))
    }

    /// What the values are logarithms of, if their header says that they are: of nothing that is
    /// read here (`None`), or of a fraction, of which they are so many absorbances.
    pub fn logarithm(&self) -> Option<Option<f64>> {
        let opens = |mark: Option<char>| matches!(mark, Some('(' | '[' | '-'));
        let is_log = |(i, word): &(usize, &Word)| {
            word.is(&["log"]) && word.power == Some(10)
                || word.is(&["log", "lg", "ln"])
                    && (*i == 0 || opens(word.before) || word.after == Some('('))
        };
        let (i, word) = self.words.iter().enumerate().find(is_log)?;
        if i > 0 && self.absorbance().is_some() {
            // `Absorbance, -log10(T)` says the same twice.
            return None;
        }
        let said = i.checked_sub(1).is_some_and(|i| self.words[i].is(&["minus", "negative"]));
        let skipped = |word: &&Word| word.is(&["of", "10"]);
        let mut of = self.words[i + 1..].iter().skip_while(skipped).peekable();
        let inverse = of.next_if(|word| word.text == "1").is_some();
        let minus = (word.before == Some('-') || said) != inverse;
        let fraction = of.next().is_some_and(|word| word.is(&TRANSMITTANCE));
        let natural = if word.is(&["ln"]) { NAPIERIAN } else { 1.0 };
        Some(fraction.then_some(if minus { natural } else { -natural }))
    }

    /// Decibels: whether of a mW.
    pub fn decibels(&self) -> Option<bool> {
        if self.has(&["dbm"]) {
            return Some(true);
        }
        self.has(&["db", "decibel", "decibels", "dbw", "dbuw", "dbµw"]).then_some(false)
    }

    /// Photocurrent over power, in so many A/W.
    pub fn amperes_per_watt(&self) -> Option<f64> {
        let joined = |word: &Word| match word.text.strip_suffix('w') {
            Some(ampere) if word.power == Some(-1) => Word::of(ampere).prefix(&AMPERE),
            _ => None,
        };
        let ratio = |(ampere, watt): (&Word, &Word)| {
            let divides = watt.before == Some('/') || watt.divides();
            let ratio = ampere.prefix(&AMPERE)? / watt.prefix(&WATT)?;
            divides.then_some(ratio)
        };
        self.pairs().find_map(ratio).or_else(|| self.words.iter().find_map(joined))
    }

    /// Whether the values are a signal over an exposure, which a pixel's area and gain turn into
    /// electrons per photon: `V/(lx s)`, `DN/(nJ/cm2)`, `A/(W/cm2)`.
    pub fn is_per_exposure(&self) -> bool {
        let energy = ["j", "joule", "joules"];
        let over =
            |word: &Word| word.divides() && (word.is(&LUX) || word.prefix(&energy).is_some());
        let volts = ["v", "volt", "volts", "dn", "adu", "lsb", "counts"];
        let over_watts = |(signal, watt): (&Word, &Word)| {
            signal.prefix(&volts).is_some() && watt.divides() && watt.prefix(&WATT).is_some()
        };
        let area = |(watt, area): (&Word, &Word)| {
            watt.divides()
                && watt.prefix(&WATT).is_some()
                && area.prefix(&["m", "cm"]).is_some()
                && area.power.is_some_and(|power| power.abs() == 2)
        };
        self.unit(over) || self.pairs().any(|pair| over_watts(pair) || area(pair))
    }

    /// Whether the values are a responsivity without a unit.
    pub fn is_bare_responsivity(&self) -> bool {
        self.has(&["responsivity"]) && !self.is_percent() && !self.is_relative()
    }

    /// Numbers of so many photons.
    pub fn photons(&self) -> Option<f64> {
        let joined = |word: &Word| {
            let prefix = |(name, _): &&(&str, f64)| word.text.starts_with(&format!("{name}mol"));
            PREFIXES[1..].iter().find(prefix).map(|(_, scale)| *scale)
        };
        let moles = |word: &Word| word.prefix(&MOLE).or_else(|| joined(word));
        let moles = self.words.iter().find_map(moles);
        let area_or_time = ["m", "cm", "mm", "s"];
        let einsteins = || {
            let einstein = |(word, next): (&Word, &Word)| {
                word.prefix(&["e"]).filter(|_| next.is(&area_or_time) && next.power.is_some())
            };
            self.pairs().find_map(einstein)
        };
        if let Some(scale) = moles.or_else(einsteins) {
            return Some(scale * MOLE_PHOTONS);
        }
        let rates = [
            &["flux", "fluence", "irradiance", "radiance", "exitance", "rate", "intensity"][..],
            &["number", "count", "counts"],
        ]
        .concat();
        let unit = |(word, next): (&Word, &Word)| {
            word.is(&["photon", "ph"]) && next.is(&area_or_time) && next.divides()
        };
        (self.has(&["photons", "quanta", "ppfd", "pfd", "ppf"])
            || self.has(&["photon", "quantum"]) && self.has(&rates)
            || self.pairs().any(unit))
        .then_some(1.0)
    }

    /// Whether the values are those of a spectrometer, of which each wavelength has its own scale.
    pub fn is_counts(&self) -> bool {
        let counts = ["counts", "count", "cps", "adu", "dn"];
        self.has(&counts) && self.photons().is_none()
    }

    /// Whether the values are per frequency by their symbol, as in `F_nu`.
    pub fn is_spectral_by_frequency(&self) -> bool {
        self.has(&["nu", "ν", "fnu", "fν", "lnu", "lν", "inu", "iν", "bnu", "bν", "snu", "sν"])
    }

    /// Power per frequency, wavenumber or energy of a photon: times which it is a power per nm
    /// over the square of the wavelength in nm.
    pub fn per_frequency(&self) -> Option<f64> {
        let hertz = [("hz", 1.0), ("khz", 1e3), ("mhz", 1e6), ("ghz", 1e9), ("thz", 1e12)];
        let jansky = |word: &Word| word.prefix(&["jy", "jansky", "janskys"]);
        let unit = |(i, word): (usize, &Word)| {
            if word.divides() && !self.is_size(i) {
                let hertz = hertz.iter().find(|(name, _)| word.is(&[name]));
                if let Some((_, hertz)) = hertz {
                    return Some(LIGHT_NM_PER_S / hertz);
                }
                if word.is(&["ev"]) {
                    return Some(PHOTON_EV_NM);
                }
            }
            jansky(word).map(|scale| scale * 1e-26 * LIGHT_NM_PER_S)
        };
        let wavenumber = |word: &Word| {
            word.is(&["cm"]) && word.power == Some(-1)
                || word.below && word.is(&["wavenumber", "kayser"])
        };
        self.words
            .iter()
            .enumerate()
            .find_map(unit)
            .or_else(|| (self.unit(wavenumber) && !self.is_per_nm()).then_some(CM_NM))
    }

    /// Whether a power per wavelength is meant.
    pub fn is_per_nm(&self) -> bool {
        self.unit(|word| word.divides() && word.is(&["nm", "µm", "um"]))
    }

    /// Whether the values are in W of some prefix.
    pub fn is_watts(&self) -> bool {
        self.unit(|word| !word.divides() && word.prefix(&WATT).is_some())
    }

    /// Whether they are weighted by how bright light looks.
    pub fn is_luminous(&self) -> bool {
        let luminous = |word: &Word| word.is(&LUX) || word.prefix(&LUMEN).is_some();
        let watts = self.words.iter().any(|word| word.prefix(&WATT).is_some());
        if !watts && self.has(&["luminous", "luminance", "illuminance"]) {
            return true;
        }
        // What is per lux or lumen is of another unit itself.
        let divided = watts || self.photons().is_some();
        self.unit(|word| luminous(word) && !(word.divides() && divided))
    }
}
