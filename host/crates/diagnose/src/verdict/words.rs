//! Statistics in words.

use crate::data::design::{Design, Stack};
use crate::statistics::codes::CODE_PERIODS;
use crate::statistics::lines::PERIODS;
use crate::statistics::maps::MapKind;
use crate::statistics::quantiles::SHARES;
use crate::statistics::spatial::SMOOTH_TERMS;
use crate::statistics::statistic::{Figure, Key, Place, What};
use crate::statistics::targets::RINGS;
use crate::statistics::temporal::LAGS;
use camrig_camera::Camera;

/// Name of a statistic, as in `diagnosis.json`.
pub fn name(camera: &Camera, key: Key) -> String {
    let channel =
        |c: u8| camera.sensor.channel_names.get(usize::from(c)).cloned().unwrap_or_default();
    let of = |text: &str, c: u8| {
        if camera.sensor.channel_names.len() > 1 {
            format!("{text} of channel {}", channel(c))
        } else {
            text.to_string()
        }
    };
    let spatial = matches!(key.0, Place::Map(_));
    let share = |i: u8| SHARES.get(usize::from(i)).copied().unwrap_or_default();
    let period = |i: u8| PERIODS.get(usize::from(i)).copied().unwrap_or_default();
    match key.1 {
        What::Mean(c) => of("mean", c),
        What::Ratio(c) => {
            format!("ratio of channel {} to the strongest, over that of another flat", channel(c))
        }
        What::Variance(c) => of("variance over time", c),
        What::FrameVariance => "variance of frame means".into(),
        What::FrameTrend => "trend of frame means".into(),
        What::FrameLag => "memory of frame means".into(),
        What::RowVariance => "variance of row means".into(),
        What::RowLag => "correlation of neighbouring rows' means".into(),
        What::RowSlow => "slow part of row means".into(),
        What::RowPeak => "line in the spectrum of row means".into(),
        What::ColumnVariance => "variance of column means".into(),
        What::ColumnSlow => "slow part of column means".into(),
        What::ColumnPeak => "line in the spectrum of column means".into(),
        What::Covariance(i) => {
            let (dx, dy) = LAGS.get(usize::from(i)).copied().unwrap_or_default();
            format!("noise correlation of pixels {dx} columns and {dy} rows apart")
        }
        What::BlockVariance => "noise of 8x8 blocks".into(),
        What::PlanePeak => "line in the two-dimensional noise spectrum".into(),
        What::Spread => "spread of the pixels' noise".into(),
        What::NoisyPixels => "number of noisy pixels".into(),
        What::NoiseSlope(i) => {
            let names = [
                "from left to right",
                "from top to bottom",
                "from middle to sides",
                "from middle to top and bottom",
                "from corner to corner",
            ];
            format!("change of the noise {}", names.get(usize::from(i)).copied().unwrap_or(""))
        }
        What::NoiseBlocks => "noise of regions (16x16 blocks)".into(),
        What::FineBlocks => "fixed structure of 16x16 blocks, smooth part left out".into(),
        What::Skewness if spatial => "skewness of pixels".into(),
        What::Skewness => "skewness of the noise".into(),
        What::Kurtosis if spatial => "kurtosis of pixels".into(),
        What::Kurtosis => "kurtosis of the noise".into(),
        What::TopKurtosis => "kurtosis of the noisiest pixels".into(),
        What::TimeLag => "correlation of a pixel's noise from frame to frame".into(),
        What::TopTimeLag => "memory of the noisiest pixels".into(),
        What::Zeros => "share of zeros".into(),
        What::Saturated => "share of saturated samples".into(),
        What::Codes(k) => {
            let period = CODE_PERIODS.get(usize::from(k)).map_or("", |p| p.name);
            format!("wave of period {period} in the code histogram")
        }
        What::Roughness => "roughness of the code histogram".into(),
        What::MissingCodes => "missing codes".into(),
        What::Slope(i) => SMOOTH_TERMS.get(usize::from(i)).copied().unwrap_or("slope").into(),
        What::RowPattern => "fixed pattern of rows".into(),
        What::RowPatternPeak => "line in the fixed pattern of rows".into(),
        What::ColumnPattern => "fixed pattern of columns".into(),
        What::ColumnPatternPeak => "line in the fixed pattern of columns".into(),
        What::ColumnPeriod(i) => format!("fixed pattern of every {}th column", period(i)),
        What::RowPeriod(i) => format!("fixed pattern of every {}th row", period(i)),
        What::PixelPattern => "fixed pattern of pixels".into(),
        What::Tails => "weight of outlying pixels".into(),
        What::High => "number of bright outliers".into(),
        What::Low => "number of dark outliers".into(),
        What::MapCovariance(i) => {
            let names = ["to the right", "below", "diagonally below"];
            let where_ = names.get(usize::from(i)).copied().unwrap_or("");
            format!("fixed correlation with the neighbour {where_}")
        }
        What::MapBlocks => "fixed structure of 16x16 blocks".into(),
        What::Corner(i) => {
            let names = ["top left", "top right", "bottom left", "bottom right"];
            format!("level of the {} corner", names.get(usize::from(i)).copied().unwrap_or(""))
        }
        What::EveryOtherRow => "fixed pattern of every other row".into(),
        What::EveryOtherColumn => "fixed pattern of every other column".into(),
        What::Checkerboard => "fixed checkerboard".into(),
        What::FallOff(c) => of("fall-off towards the corners", c),
        What::FallOffDifference(c) => {
            format!("fall-off towards the corners of channel {} against the others", channel(c))
        }
        What::Lattice => "16x16 lattice".into(),
        What::AfterImage => "mean after light".into(),
        What::Median => "median of pixels".into(),
        What::RowVarianceDn => "variance of row means in DN²".into(),
        What::FrameVarianceDn => "variance of frame means in DN²".into(),
        What::SiteMean(i) => format!("mean of site {i} of the colour filter pattern"),
        What::VarianceQuantile(i) => {
            format!("variance that {} of the pixels stay below", share(i))
        }
        What::MeanQuantile(i) => format!("mean that {} of the pixels stay below", share(i)),
        What::CodeQuantile(i) => format!("code that {} of the samples stay below", share(i)),
        What::Of(figure) => of_target(figure, &channel),
    }
}

/// Name of a figure of a target.
fn of_target(figure: Figure, channel: &dyn Fn(u8) -> String) -> String {
    let ring = |r: u8| format!("at {:.1} of the field", (f64::from(r) + 0.5) / RINGS as f64);
    match figure {
        Figure::Response { part, channel: c, tenths } => {
            let parts = ["first", "middle", "last"];
            let part = parts.get(usize::from(part)).copied().unwrap_or("");
            let f = f64::from(tenths) / 10.0;
            format!(
                "MTF of channel {} at {f} cycles per pixel, {part} third of the edge",
                channel(c)
            )
        }
        Figure::EdgeLevel { side, channel: c } => {
            let side = if side == 0 { "dark" } else { "bright" };
            format!("level of the {side} side of the edge, channel {}", channel(c))
        }
        Figure::Radial(r) => format!("displacement of dots outwards {}", ring(r)),
        Figure::Horizontal(r) => format!("displacement of dots to the right {}", ring(r)),
        Figure::SkewOfRows => "displacement of dots to the right, pixels per row".into(),
        Figure::SkewOfColumns => "displacement of dots downwards, pixels per column".into(),
        Figure::Vertical(r) => format!("displacement of dots downwards {}", ring(r)),
        Figure::LateralColour { channel: c, ring: r } => {
            format!(
                "displacement outwards of channel {} against the others {}",
                channel(c),
                ring(r)
            )
        }
        Figure::DotRadius(r) => format!("radius of dots {}", ring(r)),
        Figure::Background { channel: c, ring: r } => {
            format!("level between dots {}, channel {}", ring(r), channel(c))
        }
        Figure::PatchMean { patch: n, channel: c } => {
            format!("mean of patch {n}, channel {}", channel(c))
        }
        Figure::PatchScatter(n) => format!("scatter of the luminance in patch {n}"),
    }
}

/// Where a statistic was taken, as in `diagnosis.json`.
pub fn place(design: &Design, key: Key) -> String {
    match key.0 {
        Place::Stack(i) => design.conditions.get(i).map_or(String::new(), |c| capture(&c.stack)),
        Place::Target(i) => design.targets.get(i).map_or(String::new(), |t| capture(&t.stack)),
        Place::Map(kind) => map(kind).into(),
        Place::Set => "all captures".into(),
    }
}

fn capture(stack: &Stack) -> String {
    format!("capture {}", stack.id)
}

/// Name of a map.
pub fn map(kind: MapKind) -> &'static str {
    match kind {
        MapKind::Offset => "offset map (shortest dark)",
        MapKind::DarkCurrent => "dark-current map (rise with exposure)",
        MapKind::Gain => "gain map (flats)",
        MapKind::Curvature => "gain map, bright less medium flat",
        MapKind::AfterLight => "dark after light less dark",
    }
}
