//! Tables whose values are fractions: per cent by their header or their size, and the range that
//! they must cover.

use crate::table::{SpectralTable, Wanted};
use crate::table_quantity::Quantity;
use crate::{Error, Result};

/// Largest values of a table that are per cent: more than a measured fraction with its error, up to
/// 100 with the same.
const PERCENT: std::ops::RangeInclusive<f64> = 2.0..=102.0;
/// Largest reflectance: those of whites are measured against other whites, with their error.
const MAX_REFLECTED: f64 = 1.02;

impl SpectralTable {
    /// Converts the columns to what is wanted, which are fractions: per cent also where the header
    /// says nothing and the largest value can be no fraction. Noise below zero is taken as 0.
    ///
    /// # Errors
    /// Those of [`SpectralTable::convert`], values outside 0 to 1 (reflectances may be slightly
    /// above), and per cent that a line above the header says and neither the header nor the
    /// values.
    pub fn convert_to_fractions(&mut self, wanted: Wanted) -> Result<()> {
        let quantities = self.quantities(wanted)?;
        if quantities.iter().all(|quantity| *quantity == Quantity::Plain) {
            self.take_percent()?;
        }
        self.convert_each(&quantities, wanted);
        self.clip_noise();
        let most = if wanted == Wanted::Fraction { MAX_REFLECTED } else { 1.0 };
        for (column, values) in &self.curves {
            if let Some(i) = values.iter().position(|v| !(0.0..=most).contains(v)) {
                return Err(Error::input(format!(
                    "{} in column {column:?} at {} nm",
                    values[i], self.wavelength_nm[i]
                ))
                .help("values are fractions, 0 to 1, or per cent, 0 to 100"));
            }
        }
        Ok(())
    }

    /// Divides values that can be no fractions by 100.
    fn take_percent(&mut self) -> Result<()> {
        let largest = self.curves.iter().flat_map(|(_, v)| v).fold(0.0f64, |m, &v| m.max(v));
        if PERCENT.contains(&largest) {
            self.curves.iter_mut().flat_map(|(_, values)| values).for_each(|v| *v /= 100.0);
            self.remark(format!("its values are taken as per cent, as values go up to {largest}"));
        } else if let Some(line) = &self.percent_above {
            return Err(Error::input(format!(
                "the line {line:?} says per cent, the header below it does not, and values go up \
                 to {largest}"
            ))
            .help(
                "add (%) to the header of each column in per cent, or take it out of that line",
            ));
        }
        Ok(())
    }

    /// Refuses a table that does not reach from a wavelength to another, nm.
    ///
    /// # Errors
    /// A table that begins or ends between them.
    pub fn must_cover(&self, [least, most]: [f64; 2]) -> Result<()> {
        let (first, last) =
            (self.wavelength_nm[0], self.wavelength_nm[self.wavelength_nm.len() - 1]);
        if first > least || last < most {
            return Err(Error::input(format!("the table covers {first} to {last} nm"))
                .help(format!("it must cover at least {least} to {most} nm")));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn converted(text: &str) -> Result<SpectralTable> {
        let mut table = SpectralTable::parse(text)?;
        table.convert_to_fractions(Wanted::Transmittance).map(|()| table)
    }

    #[test]
    fn per_cent_above_the_header_is_read_or_refused() {
        let title = "Transmission of filter (%)\n";
        let high = converted(&format!("{title}wavelength_nm,T\n400,90\n500,45\n")).unwrap();
        assert_eq!(high.curves[0].1, [0.9, 0.45]);
        let low = format!("{title}wavelength_nm,T\n400,0.9\n500,0.4\n");
        let error = converted(&low).unwrap_err().to_string();
        assert!(error.contains("says per cent") && error.contains("up to 0.9"), "{error}");
        let named = converted(&low.replace(",T\n", ",T (%)\n")).unwrap();
        assert!((named.curves[0].1[0] - 0.009).abs() < 1e-12, "{named:?}");
        // What else an instrument writes above its table.
        let other = "Transmission of filter\nLamp 50 %\nwavelength_nm,T\n400,0.9\n500,0.4\n";
        assert_eq!(converted(other).unwrap().curves[0].1, [0.9, 0.4]);
    }

    #[test]
    fn values_that_are_no_fractions_are_refused() {
        for values in ["400,-0.5\n500,0.4", "400,1.5\n500,0.4", "400,150\n500,40"] {
            let error = converted(&format!("wavelength_nm,T\n{values}\n")).unwrap_err();
            assert!(error.to_string().contains("or per cent, 0 to 100"), "{values}: {error}");
        }
    }
}
