//! The positional crosstalk table: `channel,wavelength_nm,x,y,factor`.
//!
//! Factors are relative to the sensor's centre and lie on a rectangular grid, x and y from -1 to 1
//! over the sensor's half width and half height. They are interpolated bilinearly in position and
//! linearly in wavelength (section IV-C of Chen et al. 2009).

use super::csv_reader;
use camrig_base::{Error, Result};

/// A complete table: every channel at every node and wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct CrosstalkTable {
    /// Channel letters in the order of the factors.
    pub channels: Vec<String>,
    /// Columns of the grid, rising, -1 to 1.
    pub x: Vec<f32>,
    /// Rows of the grid, rising, -1 to 1.
    pub y: Vec<f32>,
    /// Wavelengths, nm, rising.
    pub wavelength_nm: Vec<f32>,
    /// Factors in the order
    /// `((channel * wavelengths + wavelength) * rows + row) * columns + column`.
    pub factors: Vec<f32>,
}

#[derive(serde::Deserialize)]
struct Line {
    channel: String,
    wavelength_nm: f32,
    x: f32,
    y: f32,
    factor: f32,
}

impl CrosstalkTable {
    /// Parses the text of a file.
    ///
    /// # Errors
    /// Lines that are not five columns, positions outside -1 to 1, negative factors (with the
    /// number of the line); nodes that are missing or listed twice.
    pub fn parse(text: &str) -> Result<Self> {
        let mut reader = csv_reader(text);
        let mut lines = Vec::new();
        let mut headers = reader.headers().cloned().unwrap_or_default();
        headers.trim();
        let mut record = csv::StringRecord::new();
        loop {
            let more = reader.read_record(&mut record).map_err(|e| {
                Error::input(format!("not a crosstalk table: {e}"))
                    .help("the columns are channel,wavelength_nm,x,y,factor")
            })?;
            if !more {
                break;
            }
            let number = record.position().map_or(0, csv::Position::line);
            let line: Line = record.deserialize(Some(&headers)).map_err(|e| {
                Error::input(format!("not a crosstalk table: {e}"))
                    .at(format!("line {number}"))
                    .help("the columns are channel,wavelength_nm,x,y,factor")
            })?;
            let position = |v: f32| (-1.0..=1.0).contains(&v);
            if !position(line.x) || !position(line.y) || !line.wavelength_nm.is_finite() {
                return Err(Error::input(format!("node at x = {}, y = {}", line.x, line.y))
                    .at(format!("line {number}"))
                    .help("x and y lie in -1..1 over the sensor's half width and half height"));
            }
            if !(line.factor.is_finite() && line.factor >= 0.0) {
                return Err(Error::input(format!("factor {}", line.factor))
                    .at(format!("line {number}"))
                    .help("factors are ratios to the centre's signal: finite, 0 or more"));
            }
            lines.push(line);
        }
        Self::from_lines(&lines)
    }

    fn from_lines(lines: &[Line]) -> Result<Self> {
        let axis = |of: fn(&Line) -> f32| {
            let mut values: Vec<f32> = lines.iter().map(of).collect();
            values.sort_by(f32::total_cmp);
            values.dedup();
            values
        };
        let (x, y, wavelength_nm) = (axis(|l| l.x), axis(|l| l.y), axis(|l| l.wavelength_nm));
        let mut channels: Vec<String> = lines.iter().map(|l| l.channel.to_lowercase()).collect();
        channels.sort();
        channels.dedup();
        let whole = channels.len() * wavelength_nm.len() * y.len() * x.len();
        if whole == 0 || whole != lines.len() || x.len() > camrig_sensor_core::crosstalk::MAX_NODES
        {
            return Err(Error::input(format!(
                "{} lines for {} channels x {} wavelengths x {} rows x {} columns",
                lines.len(),
                channels.len(),
                wavelength_nm.len(),
                y.len(),
                x.len()
            ))
            .help(format!(
                "the nodes must form a whole rectangular grid of at most {} columns, one line \
                 each",
                camrig_sensor_core::crosstalk::MAX_NODES
            )));
        }
        let mut factors = vec![f32::NAN; whole];
        let find = |axis: &[f32], v: f32| axis.partition_point(|&a| a < v);
        for l in lines {
            let c = channels.partition_point(|name| *name < l.channel.to_lowercase());
            let w = find(&wavelength_nm, l.wavelength_nm);
            let row = (c * wavelength_nm.len() + w) * y.len() + find(&y, l.y);
            factors[row * x.len() + find(&x, l.x)] = l.factor;
        }
        if factors.iter().any(|f| f.is_nan()) {
            return Err(Error::input("a node is listed twice and another one is missing")
                .help("list each channel, wavelength, x and y once"));
        }
        Ok(Self { channels, x, y, wavelength_nm, factors })
    }

    /// The table with its channels in the sensor's order, named by `letters`.
    ///
    /// # Errors
    /// A channel that the table does not have.
    pub fn for_channels(&self, letters: &[String]) -> Result<Self> {
        let per_channel = self.factors.len() / self.channels.len();
        let mut factors = Vec::with_capacity(per_channel * letters.len());
        for letter in letters {
            // The factors of g serve for gr and gb.
            let wanted = letter.to_lowercase();
            let plain = wanted.get(..1).unwrap_or("");
            let channel = self
                .channels
                .iter()
                .position(|c| *c == wanted)
                .or_else(|| self.channels.iter().position(|c| c == plain))
                .ok_or_else(|| {
                    Error::input(format!("no lines for channel {letter}"))
                        .help(format!("the table has {}", self.channels.join(", ")))
                })?;
            factors.extend_from_slice(&self.factors[channel * per_channel..][..per_channel]);
        }
        Ok(Self { channels: letters.to_vec(), factors, ..self.clone() })
    }

    /// The table in the form that `camrig-sensor-core` takes.
    pub fn as_core(&self) -> camrig_sensor_core::crosstalk::Crosstalk<'_> {
        camrig_sensor_core::crosstalk::Crosstalk {
            x: &self.x,
            y: &self.y,
            wavelength_nm: &self.wavelength_nm,
            factors: &self.factors,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: &str = "channel,wavelength_nm,x,y,factor\n\
        g,400,-1,0,0.8\ng,400,1,0,0.9\nr,400,-1,0,0.7\nr,400,1,0,0.75\n";

    #[test]
    fn channels_come_in_the_order_asked_for() {
        let table = CrosstalkTable::parse(WHOLE).unwrap();
        let table = table.for_channels(&["r".into(), "gr".into(), "gb".into()]).unwrap();
        assert_eq!(table.factors, [0.7, 0.75, 0.8, 0.9, 0.8, 0.9]);
    }

    #[test]
    fn errors_name_line_and_remedy() {
        for (text, expected) in [
            (WHOLE.replace("0.75", "x"), "line 5"),
            (WHOLE.replace("r,400,1,0,0.75\n", ""), "3 lines for 2 channels"),
            (WHOLE.replace("r,400,1,0", "r,400,-1,0"), "listed twice"),
            (WHOLE.replace("0.8", "-0.8"), "factor -0.8"),
            (WHOLE.replace("g,400,1,0", "g,400,7,0"), "x = 7"),
        ] {
            let message = CrosstalkTable::parse(&text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
