//! The figures of the standard as tables, a column per channel.

use crate::numbers::{at_least, with_error};
use crate::page::Table;
use camrig_measure::Value;
use camrig_measure::emva::{ChannelEmva, Figures};

/// Placeholder for a figure that the captures do not determine.
const NONE: &str = "–";

/// A row: its name, symbol and unit, and its figure.
struct Row {
    name: &'static str,
    symbol: &'static str,
    unit: &'static str,
    value: fn(&Figures) -> Option<Value>,
    /// Whether it is a lower limit where the light did not reach saturation.
    limited: bool,
}

const fn row(
    [name, symbol, unit]: [&'static str; 3],
    value: fn(&Figures) -> Option<Value>,
) -> Row {
    Row { name, symbol, unit, value, limited: false }
}

impl Row {
    const fn limited(self) -> Self {
        Self { limited: true, ..self }
    }

    fn cells(&self, channels: &[ChannelEmva]) -> Vec<String> {
        let mut cells = [self.name, self.symbol, self.unit].map(String::from).to_vec();
        cells.extend(channels.iter().map(|c| match (self.value)(&c.figures) {
            None => NONE.to_owned(),
            Some(v) if self.limited && !c.saturates => at_least(v.value),
            Some(v) => with_error(v.value, Some(v.std_error)),
        }));
        cells
    }
}

const SENSITIVITY: [Row; 3] = [
    row(["Quantum efficiency", "η", "%"], |f| f.quantum_efficiency.map(|q| q.scaled(100.0))),
    row(["System gain", "K", "10⁻³ DN/e⁻"], |f| f.overall_system_gain.map(|k| k.scaled(1e3))),
    row(["Inverse of the system gain", "1/K", "e⁻/DN"], |f| {
        f.overall_system_gain.map(|k| Value::new(1.0, 0.0).over(k))
    }),
];

const NOISE: [Row; 4] = [
    row(["Temporal dark noise", "σ_d", "e⁻"], |f| f.temporal_dark_noise_e),
    row(["Temporal dark noise", "σ_y.dark", "DN"], |f| f.temporal_dark_noise_dn),
    row(["Absolute sensitivity threshold", "μ_p.min", "photons"], |f| {
        f.absolute_sensitivity_threshold_p
    }),
    row(["Absolute sensitivity threshold", "μ_e.min", "e⁻"], |f| {
        f.absolute_sensitivity_threshold_e
    }),
];

const RANGE: [Row; 4] = [
    row(["Saturation capacity", "μ_p.sat", "photons"], |f| f.saturation_capacity_p).limited(),
    row(["Saturation capacity", "μ_e.sat", "e⁻"], |f| f.saturation_capacity_e).limited(),
    row(["Maximum signal-to-noise ratio", "SNR_max", "dB"], |f| f.snr_max_db).limited(),
    row(["Dynamic range", "DR", "dB"], |f| f.dynamic_range_db).limited(),
];

const SPATIAL: [Row; 2] = [
    row(["Dark signal nonuniformity", "DSNU_1288", "e⁻"], |f| f.dsnu_1288_e),
    row(["Photo response nonuniformity", "PRNU_1288", "%"], |f| f.prnu_1288_percent),
];

const LINEARITY_AND_DARK: [Row; 4] = [
    row(["Linearity error", "LE", "%"], |f| f.linearity_error_percent),
    row(["Dark current from the mean", "μ_I", "e⁻/s"], |f| f.dark_current_mean_e_per_s),
    row(["Dark current from the variance", "μ_I.var", "e⁻/s"], |f| {
        f.dark_current_variance_e_per_s
    }),
    row(["Doubling temperature", "T_d", "°C"], |f| f.dark_current_doubling_c),
];

const RESPONSE: [Row; 4] = [
    row(["Responsivity", "R", "10⁻³ DN/photon"], |f| {
        f.responsivity_dn_per_photon.map(|r| r.scaled(1e3))
    }),
    row(["System gain at small signals", "K_0", "10⁻³ DN/e⁻"], |f| {
        f.linearised_system_gain.map(|k| k.scaled(1e3))
    }),
    row(["Linearity error, lowest", "LE_min", "%"], |f| f.linearity_error_min_percent),
    row(["Linearity error, highest", "LE_max", "%"], |f| f.linearity_error_max_percent),
];

const RATIOS: [Row; 4] = [
    row(["Maximum signal-to-noise ratio", "SNR_max", "1"], |f| f.snr_max).limited(),
    row(["Maximum signal-to-noise ratio", "SNR_max", "bit"], |f| f.snr_max_bit).limited(),
    row(["Dynamic range", "DR", "1"], |f| f.dynamic_range).limited(),
    row(["Dynamic range", "DR", "bit"], |f| f.dynamic_range_bit).limited(),
];

const PARTS: [Row; 6] = [
    row(["DSNU of rows", "DSNU_1288.row", "e⁻"], |f| f.dsnu_1288_row_e),
    row(["DSNU of columns", "DSNU_1288.col", "e⁻"], |f| f.dsnu_1288_column_e),
    row(["DSNU of pixels", "DSNU_1288.pix", "e⁻"], |f| f.dsnu_1288_pixel_e),
    row(["PRNU of rows", "PRNU_1288.row", "%"], |f| f.prnu_1288_row_percent),
    row(["PRNU of columns", "PRNU_1288.col", "%"], |f| f.prnu_1288_column_percent),
    row(["PRNU of pixels", "PRNU_1288.pix", "%"], |f| f.prnu_1288_pixel_percent),
];

/// The figures that a data sheet opens with.
pub fn merit(channels: &[ChannelEmva]) -> Table {
    table(
        channels,
        &[
            ("Sensitivity", &SENSITIVITY),
            ("Temporal noise", &NOISE),
            ("Range", &RANGE),
            ("Spatial nonuniformity", &SPATIAL),
            ("Linearity and dark current", &LINEARITY_AND_DARK),
        ],
    )
}

/// The others: parts of the nonuniformities, ratios, what does not belong to the standard.
pub(crate) fn further(channels: &[ChannelEmva]) -> Table {
    table(
        channels,
        &[
            ("Components of the nonuniformity", &PARTS),
            ("Response (K₀: gain at small signals, corrected for curvature)", &RESPONSE),
            ("As ratios and bits", &RATIOS),
        ],
    )
}

fn table(channels: &[ChannelEmva], sections: &[(&str, &[Row])]) -> Table {
    let names: Vec<String> = channels.iter().map(|c| c.channel.to_uppercase()).collect();
    // A sensor without filters has one channel, which needs no name.
    let names: Vec<&str> = match names.len() {
        1 => vec!["value"],
        _ => names.iter().map(String::as_str).collect(),
    };
    let mut table = Table::new(&["figure"]).symbols(&["symbol"]).words(&["unit"]).numbers(&names);
    for (heading, rows) in sections {
        table.section(heading).rows(rows.iter().map(|row| row.cells(channels)));
    }
    table
}
