//! Spectra: bands of equal width and tabulated curves.

use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Equally spaced spectral bands. A band's value is the mean over `step_nm` around its centre, so
/// an integral over wavelength is `sum * step_nm`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bands {
    /// Centre of band 0, nm.
    pub start_nm: f64,
    /// Distance of centres, nm.
    pub step_nm: f64,
    /// Number of bands.
    pub count: usize,
}

impl Bands {
    /// 400 to 700 nm in 10 nm steps: 31 bands, as in Chen et al. 2009.
    pub const VISIBLE: Bands = Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };

    /// Centre of a band, nm.
    pub fn nm(&self, band: usize) -> f64 {
        self.start_nm + self.step_nm * band as f64
    }

    /// All centres, nm.
    pub fn centres(&self) -> impl Iterator<Item = f64> + use<> {
        let bands = *self;
        (0..bands.count).map(move |b| bands.nm(b))
    }

    /// First and last wavelength of a band, nm.
    pub fn edges_nm(&self, band: usize) -> [f64; 2] {
        [-0.5, 0.5].map(|half| self.nm(band) + half * self.step_nm)
    }
}

/// Share of a curve's largest value below which its end counts as zero: what a table printed to
/// three digits says of its ends.
const ENDS_AT_ZERO: f64 = 1e-3;

/// What a curve is at wavelengths outside its samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Outside {
    /// Its first or last value: what varies slowly, such as a lamp or a lens.
    #[default]
    Held,
    /// Zero: what makers tabulate where it matters, such as filters and quantum efficiencies.
    Zero,
}

/// A tabulated curve over wavelength, linear between its samples. In files it is its samples and
/// what it is outside them.
#[derive(Clone, Serialize, Deserialize)]
#[serde(try_from = "Samples")]
pub struct Spectrum {
    wavelength_nm: Vec<f64>,
    value: Vec<f64>,
    outside: Outside,
    /// The table that it is from; for messages alone.
    #[serde(skip)]
    table: Option<Box<Table>>,
}

/// A curve in a file, not yet checked.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Samples {
    wavelength_nm: Vec<f64>,
    value: Vec<f64>,
    outside: Outside,
}

impl TryFrom<Samples> for Spectrum {
    type Error = Error;

    fn try_from(Samples { wavelength_nm, value, outside }: Samples) -> Result<Self> {
        Ok(Self::new(wavelength_nm, value)?.outside(outside))
    }
}

/// Where a curve is from.
#[derive(Clone, Default)]
struct Table {
    /// Its name, in words.
    name: Option<String>,
    /// What was assumed in reading it.
    remarks: Vec<String>,
}

/// The same curve; where it is from does not count.
impl PartialEq for Spectrum {
    fn eq(&self, other: &Self) -> bool {
        (&self.wavelength_nm, &self.value, self.outside)
            == (&other.wavelength_nm, &other.value, other.outside)
    }
}

/// The curve alone, which identifies it in keys.
impl std::fmt::Debug for Spectrum {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut debug = f.debug_struct("Spectrum");
        debug.field("wavelength_nm", &self.wavelength_nm).field("value", &self.value);
        debug.field("outside", &self.outside).finish()
    }
}

impl Spectrum {
    /// A curve from samples: wavelengths in nm, and a value at each; held outside them.
    ///
    /// # Errors
    /// No samples, unequal numbers, wavelengths that do not rise strictly, values that are not
    /// finite.
    pub fn new(wavelength_nm: Vec<f64>, value: Vec<f64>) -> Result<Self> {
        if wavelength_nm.is_empty() || wavelength_nm.len() != value.len() {
            return Err(Error::input(format!(
                "{} wavelengths but {} values",
                wavelength_nm.len(),
                value.len()
            ))
            .help("give one value per wavelength, at least one"));
        }
        if let Some(i) = wavelength_nm.windows(2).position(|w| w[1] <= w[0] || w[1].is_nan()) {
            return Err(Error::input(format!(
                "wavelength {} nm follows {} nm",
                wavelength_nm[i + 1],
                wavelength_nm[i]
            ))
            .help("wavelengths must rise strictly"));
        }
        if let Some(i) = value.iter().position(|v| !v.is_finite()) {
            return Err(Error::input(format!("value {} at {} nm", value[i], wavelength_nm[i]))
                .help("values must be finite numbers"));
        }
        Ok(Self { wavelength_nm, value, outside: Outside::Held, table: None })
    }

    /// The same value at every wavelength.
    pub fn constant(value: f64) -> Self {
        Self {
            wavelength_nm: vec![550.0],
            value: vec![value],
            outside: Outside::Held,
            table: None,
        }
    }

    /// The wavelength itself, nm.
    pub fn wavelength() -> Self {
        Self {
            wavelength_nm: vec![0.0, 1e5],
            value: vec![0.0, 1e5],
            outside: Outside::Held,
            table: None,
        }
    }

    /// The curve with all its wavelengths times a factor above 0.
    #[must_use]
    pub fn with_wavelengths_times(&self, factor: f64) -> Self {
        let wavelength_nm = self.wavelength_nm.iter().map(|nm| nm * factor).collect();
        Self { wavelength_nm, ..self.clone() }
    }

    /// The curve with other values outside its samples.
    #[must_use]
    pub fn outside(mut self, outside: Outside) -> Self {
        self.outside = outside;
        self
    }

    /// The curve with remarks on how its table was read, for [`Spectrum::notes`].
    #[must_use]
    pub fn remarked(mut self, remarks: &[String]) -> Self {
        if !remarks.is_empty() {
            self.table.get_or_insert_default().remarks.extend_from_slice(remarks);
        }
        self
    }

    /// Remarks for the user: what was assumed in reading the table, and where `bands` reach beyond
    /// its end.
    pub fn notes(&self, bands: &Bands) -> Vec<String> {
        let Some(table) = &self.table else { return Vec::new() };
        table.remarks.iter().cloned().chain(self.beyond(bands)).collect()
    }

    /// The curve as one from a table, which [`Spectrum::notes`] names.
    #[must_use]
    pub fn from_table(mut self, source: impl Into<String>) -> Self {
        self.table.get_or_insert_default().name = Some(source.into());
        self
    }

    /// What to tell the user where `bands` reach beyond the table that this curve is from, and its
    /// end is not zero: what is taken there may be far from the truth (a quantum efficiency that
    /// ends at 720 nm, a lamp measured to 650 nm).
    pub fn beyond(&self, bands: &Bands) -> Option<String> {
        let source = self.table.as_ref()?.name.as_ref()?;
        let largest = self.value.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let counts = |value: f64| value.abs() > ENDS_AT_ZERO * largest;
        let (first, last) = self.range_nm();
        let (low, high) = (bands.nm(0), bands.nm(bands.count.saturating_sub(1)));
        let (start, end) = (self.value[0], self.value[self.value.len() - 1]);
        let (taken, remedy) = match self.outside {
            Outside::Held => ("held", "(with zeros, where it is 0)"),
            Outside::Zero => ("taken as 0", "(or says `# outside: held` if it goes on so)"),
        };
        let mut ends = Vec::new();
        if low < first && counts(start) {
            ends.push(format!(
                "begins at {first} nm with {start:.3}, and is {taken} down to {low} nm"
            ));
        }
        if high > last && counts(end) {
            ends.push(format!("ends at {last} nm with {end:.3}, and is {taken} up to {high} nm"));
        }
        (!ends.is_empty()).then(|| {
            let ends = ends.join(" and ");
            format!("{source} {ends}: use a table that reaches further if that is not so {remedy}")
        })
    }

    /// First and last tabulated wavelength, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        (self.wavelength_nm[0], self.wavelength_nm[self.wavelength_nm.len() - 1])
    }

    /// The samples as (wavelength in nm, value).
    pub fn samples(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.wavelength_nm.iter().copied().zip(self.value.iter().copied())
    }

    /// The value at a wavelength: linear between samples; outside them as [`Outside`] says.
    pub fn at(&self, nm: f64) -> f64 {
        let (first, last) = self.range_nm();
        if self.outside == Outside::Zero && !(first..=last).contains(&nm) {
            return 0.0;
        }
        let i = self.wavelength_nm.partition_point(|&w| w <= nm);
        if i == 0 {
            return self.value[0];
        }
        if i == self.wavelength_nm.len() {
            return self.value[i - 1];
        }
        let (w0, w1) = (self.wavelength_nm[i - 1], self.wavelength_nm[i]);
        let t = (nm - w0) / (w1 - w0);
        self.value[i - 1] + t * (self.value[i] - self.value[i - 1])
    }

    /// The product of two curves at the samples of both, linear between them; zero outside where
    /// one of them is.
    ///
    /// # Errors
    /// None while products of the values are finite.
    pub fn times(&self, other: &Self) -> Result<Self> {
        let both = [self, other];
        let zero = || both.into_iter().filter(|s| s.outside == Outside::Zero);
        let mut nm: Vec<f64> = both.iter().flat_map(|s| &s.wavelength_nm).copied().collect();
        nm.retain(|nm| zero().all(|s| (s.range_nm().0..=s.range_nm().1).contains(nm)));
        nm.sort_by(f64::total_cmp);
        nm.dedup();
        if nm.is_empty() {
            return Ok(Self::constant(0.0));
        }
        let value = nm.iter().map(|&nm| self.at(nm) * other.at(nm)).collect();
        let outside = zero().next().map_or(Outside::Held, |s| s.outside);
        Ok(Self::new(nm, value)?.outside(outside))
    }

    /// The value at each band's centre.
    pub fn sample(&self, bands: &Bands) -> Vec<f64> {
        bands.centres().map(|nm| self.at(nm)).collect()
    }

    /// The value of each band: where the table is finer than the bands, the exact mean of the
    /// curve over the band, so that emission lines keep their power; else the value at the band's
    /// centre.
    pub fn in_bands(&self, bands: &Bands) -> Vec<f64> {
        let (first, last) = self.range_nm();
        let spacing = (last - first) / (self.value.len() - 1).max(1) as f64;
        if self.value.len() == 1 || spacing > bands.step_nm - 1e-6 {
            return self.sample(bands);
        }
        let half = bands.step_nm / 2.0;
        bands.centres().map(|nm| self.mean(nm - half, nm + half)).collect()
    }

    /// The exact mean of the curve from one wavelength to a longer one, nm.
    pub fn mean(&self, from_nm: f64, to_nm: f64) -> f64 {
        let (start, end) = match self.outside {
            Outside::Held => (from_nm, to_nm),
            Outside::Zero => {
                let (first, last) = self.range_nm();
                (from_nm.max(first), to_nm.min(last))
            }
        };
        if start >= end {
            return 0.0;
        }
        let first = self.wavelength_nm.partition_point(|&w| w <= start);
        let (mut previous, mut area) = ((start, self.at(start)), 0.0);
        let inside = self.wavelength_nm[first..].iter().copied().zip(&self.value[first..]);
        let inside = inside.map(|(w, &v)| (w, v)).take_while(|&(w, _)| w < end);
        for (nm, value) in inside.chain([(end, self.at(end))]) {
            area += (nm - previous.0) * (value + previous.1) / 2.0;
            previous = (nm, value);
        }
        area / (to_nm - from_nm)
    }

    /// The exact mean of the curve over each band.
    pub fn means(&self, bands: &Bands) -> Vec<f64> {
        (0..bands.count).map(|band| bands.edges_nm(band)).map(|[a, b]| self.mean(a, b)).collect()
    }
}

/// ∫ Π f_i(λ) dλ of curves from one wavelength to a longer one, nm.
///
/// It is exact: between neighbouring samples of any of the curves the product of n of them is a
/// polynomial of degree n, which Gauss-Legendre quadrature of five nodes integrates up to degree
/// 9. So neither a filter narrower than a band, nor an edge, nor a line between the samples of the
/// other curves is lost. It costs five values of each curve per interval.
///
/// # Panics
/// In builds with debug assertions, of more than nine curves.
pub fn integral_of_product(curves: &[&Spectrum], from_nm: f64, to_nm: f64) -> f64 {
    /// Abscissae in -1..1 and weights (M. Abramowitz, I. A. Stegun, table 25.4).
    const NODES: [(f64, f64); 5] = [
        (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
        (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
        (0.0, 0.568_888_888_888_888_9),
        (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
        (0.906_179_845_938_664, 0.236_926_885_056_189_1),
    ];
    debug_assert!(curves.len() < 2 * NODES.len(), "a product of {} curves", curves.len());
    let inside = |curve: &&Spectrum| {
        let nm = &curve.wavelength_nm;
        let first = nm.partition_point(|&w| w <= from_nm);
        let end = nm.partition_point(|&w| w < to_nm).max(first);
        nm[first..end].to_vec()
    };
    let mut ends: Vec<f64> = curves.iter().flat_map(inside).chain([from_nm, to_nm]).collect();
    ends.sort_by(f64::total_cmp);
    ends.dedup();
    let of_interval = |ends: &[f64]| {
        let (middle, half) = ((ends[0] + ends[1]) / 2.0, (ends[1] - ends[0]) / 2.0);
        let product = |nm: f64| curves.iter().map(|curve| curve.at(nm)).product::<f64>();
        NODES.iter().map(|(x, weight)| weight * half * product(middle + half * x)).sum::<f64>()
    };
    ends.windows(2).map(of_interval).sum()
}

/// The mean of the product of `curves` over each band, weighted by the product of `weights`:
/// ∫ Πf Πw dλ / ∫ Πw dλ. Where the weights are 0 all over a band, it is the plain mean.
pub fn weighted_means(curves: &[&Spectrum], weights: &[&Spectrum], bands: &Bands) -> Vec<f64> {
    let all = [curves, weights].concat();
    let of_band = |band: usize| {
        let [from_nm, to_nm] = bands.edges_nm(band);
        let weight = integral_of_product(weights, from_nm, to_nm);
        if weight > 0.0 {
            return integral_of_product(&all, from_nm, to_nm) / weight;
        }
        integral_of_product(curves, from_nm, to_nm) / bands.step_nm
    };
    (0..bands.count).map(of_band).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_that_ends_above_zero_is_told_where_bands_reach_beyond_it() {
        let table = Spectrum::new(vec![400.0, 600.0, 720.0], vec![0.1, 0.6, 0.4]).unwrap();
        let table = table.from_table("qe.csv");
        let bands = |start_nm, count| Bands { start_nm, step_nm: 10.0, count };
        assert_eq!(table.beyond(&bands(400.0, 33)), None);
        let said = table.beyond(&bands(360.0, 65)).unwrap();
        for part in ["qe.csv", "at 400 nm with 0.100", "360 nm", "at 720 nm with 0.400", "1000 nm"]
        {
            assert!(said.contains(part), "{said}");
        }
        let zeros = Spectrum::new(vec![400.0, 600.0, 720.0], vec![0.0, 0.6, 5e-4]).unwrap();
        assert_eq!(zeros.from_table("qe.csv").beyond(&bands(360.0, 65)), None);
        assert_eq!(Spectrum::constant(0.5).beyond(&bands(360.0, 65)), None);
    }

    #[test]
    fn what_is_outside_a_table_is_held_or_zero() {
        let table = Spectrum::new(vec![400.0, 405.0, 410.0], vec![2.0, 4.0, 4.0]).unwrap();
        assert_eq!((table.at(390.0), table.at(420.0), table.mean(400.0, 420.0)), (2.0, 4.0, 3.75));
        let zero = table.clone().outside(Outside::Zero);
        assert_eq!([390.0, 400.0, 410.0, 410.1].map(|nm| zero.at(nm)), [0.0, 2.0, 4.0, 0.0]);
        // 35 nm under the curve in 20 nm.
        assert_eq!((zero.mean(395.0, 415.0), zero.mean(411.0, 415.0)), (35.0 / 20.0, 0.0));
        let said = zero.clone().from_table("qe").beyond(&Bands::VISIBLE).unwrap();
        assert!(said.contains("410 nm with 4.000, and is taken as 0 up to 700 nm"), "{said}");
        let wide = Spectrum::new(vec![380.0, 408.0, 800.0], vec![1.0, 1.0, 1.0]).unwrap();
        let product = wide.times(&zero).unwrap();
        assert_eq!([399.9, 402.5, 409.0, 411.0].map(|nm| product.at(nm)), [0.0, 3.0, 4.0, 0.0]);
    }

    #[test]
    fn products_of_curves_are_integrated_exactly() {
        let curve =
            |nm: &[f64], value: &[f64]| Spectrum::new(nm.to_vec(), value.to_vec()).unwrap();
        // A triangle of height 1 and half width 5 nm at 555 nm, times λ - 500: 5 (555 - 500).
        let filter = curve(&[550.0, 555.0, 560.0], &[0.0, 1.0, 0.0]).outside(Outside::Zero);
        let rising = curve(&[500.0, 600.0], &[0.0, 100.0]);
        let whole = integral_of_product(&[&filter, &rising], 545.0, 565.0);
        assert!((whole - 5.0 * 55.0).abs() < 1e-9, "{whole}");
        // Its halves, and bands that split it, add up to the whole.
        let bands = Bands { start_nm: 550.0, step_nm: 10.0, count: 2 };
        let parts: f64 = weighted_means(&[&filter, &rising], &[], &bands).iter().sum();
        assert!((10.0 * parts - whole).abs() < 1e-9, "{parts}");
        // The sixth power of λ - 500 over 500 to 520 nm, in nm⁷ / 7.
        let power = integral_of_product(&[&rising; 6], 500.0, 520.0);
        assert!((power / (20f64.powi(7) / 7.0) - 1.0).abs() < 1e-12, "{power}");
        // An edge that falls from 1 to 0 at 557 nm, seen in a line at 552 and at 559 nm.
        let edge = curve(&[400.0, 557.0], &[1.0, 1.0]).outside(Outside::Zero);
        for (centre, expected) in [(552.0, 1.0), (559.0, 0.0)] {
            let line = curve(&[centre - 1.0, centre, centre + 1.0], &[0.0, 1.0, 0.0]);
            let seen = weighted_means(&[&edge], &[&line.outside(Outside::Zero)], &bands);
            assert!((seen[usize::from(centre > 555.0)] - expected).abs() < 1e-12, "{seen:?}");
        }
    }

    #[test]
    fn curves_are_read_as_they_were_written() {
        let curve = Spectrum::new(vec![400.0, 405.5], vec![0.25, 0.3125]).unwrap();
        let curve = curve.outside(Outside::Zero);
        let text = serde_json::to_string(&curve).unwrap();
        assert_eq!(serde_json::from_str::<Spectrum>(&text).unwrap(), curve);
        assert!(serde_json::from_str::<Spectrum>(&text.replace("405.5", "399")).is_err());
    }

    #[test]
    fn fine_tables_are_averaged_and_coarse_ones_sampled() {
        let fine = Spectrum::new(vec![400.0, 405.0, 410.0], vec![0.0, 8.0, 0.0]).unwrap();
        let bands = Bands { start_nm: 405.0, step_nm: 10.0, count: 1 };
        assert_eq!(fine.in_bands(&bands), [4.0]);
        assert_eq!(fine.mean(402.5, 407.5), 6.0);
        assert_eq!(fine.mean(410.0, 420.0), 0.0);
        let coarse = Spectrum::new(vec![395.0, 405.0, 415.0], vec![0.0, 8.0, 0.0]).unwrap();
        assert_eq!(coarse.in_bands(&bands), [8.0]);
    }
}
