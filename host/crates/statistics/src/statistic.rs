//! What a statistic is: where it was measured, what it measures, its value and standard deviation,
//! and the scale on which it is normally distributed.
//!
//! Statistics are summed in the order of the variants, which therefore is part of the result: new
//! variants go to the end.

use super::maps::MapKind;
use std::collections::BTreeMap;

/// Where a statistic was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// A dark or flat stack: its index in [`Design::conditions`](crate::data::design::Design).
    Stack(usize),
    /// A capture of a target: its index in [`Design::targets`](crate::data::design::Design).
    Target(usize),
    /// A map made of several stacks.
    Map(MapKind),
    /// All stacks together.
    Set,
}

/// Index of a channel in the camera's `channel_names`.
pub type Channel = u8;
/// Index into [`LAGS`](super::temporal::LAGS): the distance of two pixels in columns and rows.
pub type Lag = u8;
/// Index into [`SMOOTH_TERMS`](super::spatial::SMOOTH_TERMS): a slope or curvature over the
/// sensor.
pub type Term = u8;
/// Index into [`CODE_PERIODS`](super::codes::CODE_PERIODS): a period of the converter's codes.
pub type CodePeriod = u8;
/// Index into [`PERIODS`](super::lines::PERIODS): a period of rows or columns.
pub type LinePeriod = u8;
/// A neighbour: to the right (0), below (1), diagonally below (2).
pub type Neighbour = u8;
/// A corner of the sensor: top left, top right, bottom left, bottom right.
pub type Corner = u8;

/// What a statistic measures.
///
/// "White" means noise that is independent between pixels and frames, with the stack's pixel
/// variance; ratios to it are 1 where there is no other noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum What {
    /// Mean of a channel, DN, relative to the reference dark; absolute for that stack itself.
    Mean(Channel),
    /// Ratio of a channel to the one with most light, divided by that of the reference flat.
    Ratio(Channel),
    /// Variance over time of a channel's pixels, without the components of frames, rows and
    /// columns, DN².
    Variance(Channel),
    /// Variance of the frames' means over that of white noise.
    FrameVariance,
    /// Slope of the frames' means over time, in standard deviations.
    FrameTrend,
    /// Correlation of the means of successive frames.
    FrameLag,
    /// Variance over time of row means over that of white noise.
    RowVariance,
    /// Correlation of the means of neighbouring rows.
    RowLag,
    /// Power of row means at the lowest frequencies over the mean of all.
    RowSlow,
    /// Highest line in the spectrum of row means, as a standard normal variate.
    RowPeak,
    /// Variance over time of column means over that of white noise.
    ColumnVariance,
    /// Power of column means at the lowest frequencies over the mean of all.
    ColumnSlow,
    /// Highest line in the spectrum of column means, as a standard normal variate.
    ColumnPeak,
    /// Correlation over time of pixels at a lag.
    Covariance(Lag),
    /// Variance over time of means of 8x8 pixels over that of white noise.
    BlockVariance,
    /// Highest line in the two-dimensional spectrum of pixels, as a standard normal variate.
    PlanePeak,
    /// Spread of the pixels' variances relative to that of a χ² distribution.
    Spread,
    /// Number of pixels whose variance a χ² distribution exceeds once in a million.
    NoisyPixels,
    /// Change of the pixels' variance over the sensor, relative to its mean.
    NoiseSlope(Term),
    /// Variance of the noise of 16x16 blocks relative to independent pixels.
    NoiseBlocks,
    /// Skewness of the noise over time; that of the octiles of a map's pixels.
    Skewness,
    /// Excess kurtosis of the noise over time; that of the octiles of a map's pixels.
    Kurtosis,
    /// Fourth moment over squared variance of the noisiest pixels.
    TopKurtosis,
    /// Correlation of a pixel's noise in successive frames.
    TimeLag,
    /// The same of the noisiest pixels.
    TopTimeLag,
    /// Share of samples of code 0.
    Zeros,
    /// Share of samples at the highest code.
    Saturated,
    /// Power of a wave of a period in codes in the histogram, relative to its Poisson scatter.
    Codes(CodePeriod),
    /// Mean square fourth difference of the histogram relative to its Poisson scatter.
    Roughness,
    /// Number of codes that do not occur between two that do.
    MissingCodes,
    /// Slope or curvature of a map, RMS, in the map's unit.
    Slope(Term),
    /// Variance of a map's row means, without the periodic part, in the map's unit squared.
    RowPattern,
    /// Highest line in the spectrum of a map's row means, as a standard normal variate.
    RowPatternPeak,
    /// Variance of a map's column means, without the periodic part, in the map's unit squared.
    ColumnPattern,
    /// Highest line in the spectrum of a map's column means, as a standard normal variate.
    ColumnPatternPeak,
    /// Variance of a map's columns between the phases of a period relative to that within.
    ColumnPeriod(LinePeriod),
    /// Variance of a map's rows between the phases of a period relative to that within.
    RowPeriod(LinePeriod),
    /// Variance of a map's pixels, outliers clipped, in the map's unit squared.
    PixelPattern,
    /// Variance of a map's pixels relative to that with outliers clipped.
    Tails,
    /// Number of bright outliers of a map.
    High,
    /// Number of dark outliers of a map.
    Low,
    /// Correlation of a map's pixels with a neighbour.
    MapCovariance(Neighbour),
    /// Variance of a map's 16x16 blocks relative to independent pixels.
    MapBlocks,
    /// The same after subtraction of the smooth part.
    FineBlocks,
    /// Mean of a corner of a map, in the map's unit.
    Corner(Corner),
    /// Mean of a map's even rows minus that of its odd rows, in the map's unit.
    EveryOtherRow,
    /// Mean of a map's even columns minus that of its odd columns, in the map's unit.
    EveryOtherColumn,
    /// Mean of one half of a map's checkerboard minus that of the other, in the map's unit.
    Checkerboard,
    /// Relative change of a channel's gain from the centre to the corners.
    FallOff(Channel),
    /// The same minus that of the channel with most pixels.
    FallOffDifference(Channel),
    /// Largest mean over a phase of the 16x16 lattice of a map, as a standard normal variate.
    Lattice,
    /// Mean signal of the dark frames after light, relative to that light.
    AfterImage,
    /// A figure of a target.
    Of(Figure),
    /// Median of a map's pixels, in the map's unit: its level without the influence of hot pixels.
    Median,
    /// Mean of a site of the colour filter pattern, outliers clipped, DN.
    SiteMean(Site),
    /// Variance over time of row means, DN².
    RowVarianceDn,
    /// Variance of the frames' means, DN².
    FrameVarianceDn,
    /// Quantile over pixels of their variance over time, DN².
    VarianceQuantile(Share),
    /// Quantile over pixels of their means, above the median, DN.
    MeanQuantile(Share),
    /// Quantile of all samples, each code spread evenly over its width, above the median, DN.
    CodeQuantile(Share),
}

/// Number of a site of the colour filter pattern, row by row.
pub type Site = u8;
/// Index into [`SHARES`](super::quantiles::SHARES): the share of pixels or samples below a
/// quantile.
pub type Share = u8;

/// Ring of a dot's distance from the centre of the frame: 0 to [`RINGS`](super::targets::RINGS) −
/// 1.
pub type Ring = u8;

/// A figure of a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Figure {
    /// MTF along an edge.
    Response {
        /// Part of the edge, from its start: 0 to 2.
        part: u8,
        /// Channel.
        channel: Channel,
        /// Spatial frequency, tenths of a cycle per pixel.
        tenths: u8,
    },
    /// Level of a side of an edge, DN above black.
    EdgeLevel {
        /// Dark (0) or bright (1) side.
        side: u8,
        /// Channel.
        channel: Channel,
    },
    /// Mean displacement of dots from their ideal positions, away from the centre, pixels.
    Radial(Ring),
    /// The same to the right.
    Horizontal(Ring),
    /// The same downwards.
    Vertical(Ring),
    /// Displacement of a channel's dots away from the centre, relative to those of the most densely
    /// sampled channel, pixels.
    LateralColour {
        /// Channel.
        channel: Channel,
        /// Ring.
        ring: Ring,
    },
    /// Root mean square radius of the dots, pixels.
    DotRadius(Ring),
    /// Level between the dots, DN above black.
    Background {
        /// Channel.
        channel: Channel,
        /// Ring.
        ring: Ring,
    },
    /// Mean of a patch of a ColorChecker, DN above black.
    PatchMean {
        /// Number of the patch, from 1.
        patch: u8,
        /// Channel.
        channel: Channel,
    },
    /// Standard deviation of the luminance within a patch, DN: number of the patch, from 1.
    PatchScatter(u8),
    /// Displacement of dots to the right for each row down, pixels: the skew of a rolling shutter,
    /// or a turn of the target.
    SkewOfRows,
    /// Displacement of dots downwards for each column to the right, pixels: of a turn the opposite
    /// of the other.
    SkewOfColumns,
}

impl Figure {
    /// Whether it is proportional to the amount of light.
    pub fn is_level(self) -> bool {
        matches!(self, Self::EdgeLevel { .. } | Self::Background { .. } | Self::PatchMean { .. })
    }
}

impl What {
    /// Whether it shows how the noise of a stack differs from pixel to pixel.
    pub fn is_of_single_pixels(self) -> bool {
        matches!(
            self,
            Self::Spread
                | Self::NoisyPixels
                | Self::NoiseSlope(_)
                | Self::NoiseBlocks
                | Self::Skewness
                | Self::Kurtosis
                | Self::TopKurtosis
                | Self::TopTimeLag
        )
    }

    /// Whether it only bars effects that do harm: quantiles say the same as variances, means and
    /// counts of outliers do, so that they add nothing to a likelihood.
    pub fn only_bars(self) -> bool {
        matches!(
            self,
            Self::SiteMean(_)
                | Self::RowVarianceDn
                | Self::FrameVarianceDn
                | Self::VarianceQuantile(_)
                | Self::MeanQuantile(_)
                | Self::CodeQuantile(_)
        )
    }

    /// Whether the standard deviation of the measured value counts in addition to that of
    /// replicates: an outlier in a patch is a chance event, which the patch's kurtosis shows.
    pub fn has_own_uncertainty(self) -> bool {
        matches!(self, Self::Of(Figure::PatchScatter(_)))
    }
}

/// The scale on which a statistic is normally distributed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Its own unit.
    Linear,
    /// Its natural logarithm.
    Log,
    /// Its cube root (means of squares with few degrees of freedom).
    CubeRoot,
    /// A count of rare events.
    Count,
}

impl Scale {
    /// Transforms a value to this scale.
    pub fn of(self, value: f64) -> f64 {
        match self {
            Scale::Linear | Scale::Count => value,
            Scale::Log => libm::log(value.max(1e-12)),
            Scale::CubeRoot => libm::cbrt(value.max(0.0)),
        }
    }
}

/// One statistic.
#[derive(Clone, Copy, Debug)]
pub struct Statistic {
    /// Where it was measured.
    pub place: Place,
    /// What it measures.
    pub what: What,
    /// Its value, in its own unit.
    pub value: f64,
    /// Standard deviation on its scale, from its sampling distribution; unused for counts.
    pub sd: f64,
    /// Its scale.
    pub scale: Scale,
}

/// Name of a statistic.
pub type Key = (Place, What);
/// Statistics by name.
pub type Values = BTreeMap<Key, Statistic>;

/// Statistics by name.
pub fn by_key(statistics: Vec<Statistic>) -> Values {
    statistics.into_iter().map(|s| ((s.place, s.what), s)).collect()
}
