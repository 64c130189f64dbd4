//! The figures of the standard as tables, a column per channel.

use crate::numbers::{at_least, with_error};
use crate::page::Table;
use camrig_measure::emva::ChannelEmva;

/// Placeholder for a figure that the captures do not determine.
const NONE: &str = "–";

/// A row: its name, symbol and unit, its value and standard error.
struct Row {
    name: &'static str,
    symbol: &'static str,
    unit: &'static str,
    value: fn(&ChannelEmva) -> Option<f64>,
    error: fn(&ChannelEmva) -> Option<f64>,
    /// Whether it is a lower limit where the light did not reach saturation.
    limited: bool,
}

/// A row without an error estimate.
const fn row(
    [name, symbol, unit]: [&'static str; 3],
    value: fn(&ChannelEmva) -> Option<f64>,
) -> Row {
    Row { name, symbol, unit, value, error: |_| None, limited: false }
}

impl Row {
    const fn error(self, error: fn(&ChannelEmva) -> Option<f64>) -> Self {
        Self { error, ..self }
    }

    const fn limited(self) -> Self {
        Self { limited: true, ..self }
    }

    fn cells(&self, channels: &[ChannelEmva]) -> Vec<String> {
        let mut cells = [self.name, self.symbol, self.unit].map(String::from).to_vec();
        cells.extend(channels.iter().map(|c| match (self.value)(c) {
            None => NONE.to_owned(),
            Some(value) if self.limited && !c.saturates => at_least(value),
            Some(value) => with_error(value, (self.error)(c)),
        }));
        cells
    }
}

const SENSITIVITY: [Row; 3] = [
    row(["Quantum efficiency", "η", "%"], |c| c.figures.quantum_efficiency.map(|q| 100.0 * q))
        .error(|c| c.std_errors.quantum_efficiency.map(|e| 100.0 * e)),
    row(["System gain", "K", "10⁻³ DN/e⁻"], |c| Some(1e3 * c.figures.overall_system_gain))
        .error(|c| Some(1e3 * c.std_errors.overall_system_gain)),
    row(["Inverse of the system gain", "1/K", "e⁻/DN"], |c| {
        Some(1.0 / c.figures.overall_system_gain)
    })
    .error(|c| Some(c.std_errors.overall_system_gain / c.figures.overall_system_gain.powi(2))),
];

const NOISE: [Row; 4] = [
    row(["Temporal dark noise", "σ_d", "e⁻"], |c| c.figures.temporal_dark_noise_e)
        .error(|c| c.std_errors.temporal_dark_noise_e),
    row(["Temporal dark noise", "σ_y.dark", "DN"], |c| Some(c.figures.temporal_dark_noise_dn)),
    row(["Absolute sensitivity threshold", "μ_p.min", "photons"], |c| {
        c.figures.absolute_sensitivity_threshold_p
    }),
    row(["Absolute sensitivity threshold", "μ_e.min", "e⁻"], |c| {
        Some(c.figures.absolute_sensitivity_threshold_e)
    }),
];

const RANGE: [Row; 4] = [
    row(["Saturation capacity", "μ_p.sat", "photons"], |c| c.figures.saturation_capacity_p)
        .limited(),
    row(["Saturation capacity", "μ_e.sat", "e⁻"], |c| Some(c.figures.saturation_capacity_e))
        .limited(),
    row(["Maximum signal-to-noise ratio", "SNR_max", "dB"], |c| Some(c.figures.snr_max_db))
        .limited(),
    row(["Dynamic range", "DR", "dB"], |c| Some(c.figures.dynamic_range_db)).limited(),
];

const SPATIAL: [Row; 2] = [
    row(["Dark signal nonuniformity", "DSNU_1288", "e⁻"], |c| c.figures.dsnu_1288_e)
        .error(|c| c.std_errors.dsnu_1288_e),
    row(["Photo response nonuniformity", "PRNU_1288", "%"], |c| c.figures.prnu_1288_percent)
        .error(|c| c.std_errors.prnu_1288_percent),
];

const LINEARITY_AND_DARK: [Row; 4] = [
    row(["Linearity error", "LE", "%"], |c| c.figures.linearity_error_percent),
    row(["Dark current from the mean", "μ_I", "e⁻/s"], |c| c.figures.dark_current_mean_e_per_s),
    row(["Dark current from the variance", "μ_I.var", "e⁻/s"], |c| {
        c.figures.dark_current_variance_e_per_s
    }),
    row(["Doubling temperature", "T_d", "°C"], |c| c.figures.dark_current_doubling_c),
];

const RESPONSE: [Row; 4] = [
    row(["Responsivity", "R", "10⁻³ DN/photon"], |c| {
        c.figures.responsivity_dn_per_photon.map(|r| 1e3 * r)
    }),
    row(["System gain at small signals", "K_0", "10⁻³ DN/e⁻"], |c| {
        c.figures.linearised_system_gain.map(|k| 1e3 * k)
    })
    .error(|c| c.std_errors.linearised_system_gain.map(|e| 1e3 * e)),
    row(["Linearity error, lowest", "LE_min", "%"], |c| c.figures.linearity_error_min_percent),
    row(["Linearity error, highest", "LE_max", "%"], |c| c.figures.linearity_error_max_percent),
];

const RATIOS: [Row; 4] = [
    row(["Maximum signal-to-noise ratio", "SNR_max", "1"], |c| Some(c.figures.snr_max)).limited(),
    row(["Maximum signal-to-noise ratio", "SNR_max", "bit"], |c| Some(c.figures.snr_max_bit))
        .limited(),
    row(["Dynamic range", "DR", "1"], |c| Some(c.figures.dynamic_range)).limited(),
    row(["Dynamic range", "DR", "bit"], |c| Some(c.figures.dynamic_range_bit)).limited(),
];

const PARTS: [Row; 6] = [
    row(["DSNU of rows", "DSNU_1288.row", "e⁻"], |c| c.figures.dsnu_1288_row_e),
    row(["DSNU of columns", "DSNU_1288.col", "e⁻"], |c| c.figures.dsnu_1288_column_e),
    row(["DSNU of pixels", "DSNU_1288.pix", "e⁻"], |c| c.figures.dsnu_1288_pixel_e),
    row(["PRNU of rows", "PRNU_1288.row", "%"], |c| c.figures.prnu_1288_row_percent),
    row(["PRNU of columns", "PRNU_1288.col", "%"], |c| c.figures.prnu_1288_column_percent),
    row(["PRNU of pixels", "PRNU_1288.pix", "%"], |c| c.figures.prnu_1288_pixel_percent),
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
