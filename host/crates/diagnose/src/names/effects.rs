//! The test of each effect, its amounts, and the parameters that it gives.

use super::gather::Given;
use crate::candidates::proposal::Proposal;
use crate::model::effects::current;
use crate::report::Amount;
use camrig_base::{Value, tails};
use camrig_camera::Camera;
use camrig_estimates::Estimates;
use camrig_estimates::areas::Area;
use camrig_estimates::bias::Bias;
use camrig_estimates::dark::variance_of_mean;
use camrig_estimates::flat::{Flat, Wave};
use camrig_estimates::gains::Parts;
use camrig_estimates::prnu::Prnu;
use camrig_fourier::sinc;
use std::f64::consts::SQRT_2;

/// Pixels of a share that a set must be able to show: two in ten thousand blink on common sensors.
const BLINKING_SHARE: f64 = 2e-4;
const MIN_PIXELS: f64 = 5.0;
/// Deviation from the median variance from which [`camrig_estimates::bias`] counts a pixel as
/// noisy.
const NOISY: f64 = 6.0;
/// Most columns and areas that are listed by number.
const MAX_LISTED: usize = 8;
/// Error of a level in DN below which half a code is told from other offsets.
const MAX_CODE_ERROR: f64 = 0.08;
/// Deviation from which frames' offsets widen the errors of levels.
const MIN_OFFSETS: f64 = 3.0;
/// Largest correlation of a frame's offset with the next in the effect.
const MAX_CORRELATION: f64 = 0.95;
/// Chance from frame to frame that a blinking pixel is renewed, where the frames are too few to
/// show it: between that of frames in close succession and of independent ones.
const RENEWAL: f64 = 0.5;
/// Twice the frequencies of the mains, Hz.
const FLICKER_HZ: f64 = 100.0;
const OTHER_HZ: f64 = 120.0;
/// The power of a frequency over the median from which flicker stands out.
const MIN_POWER: f64 = 30.0;

/// Share of the change of variance over mean that the mean has to show for it to be the gain's.
const MIN_MOVED: f64 = 0.5;

/// One effect in the captures against a model.
pub(super) struct Test {
    pub effect: &'static str,
    /// Captures less model, in standard errors of the difference.
    pub deviation: f64,
    pub amounts: Vec<Amount>,
    /// The statistic that shows it.
    pub shown_by: &'static str,
    /// Whether the captures show only a part of what the effect is.
    pub in_part: bool,
    /// Why the set cannot decide.
    pub undecided: Option<&'static str>,
}

impl Test {
    fn new(effect: &'static str, deviation: f64, shown_by: &'static str) -> Self {
        let (amounts, undecided) = (Vec::new(), None);
        Self { effect, deviation, amounts, shown_by, in_part: false, undecided }
    }

    fn with(mut self, name: &str, value: Value, unit: &str) -> Self {
        self.amounts.push(Amount {
            name: name.into(),
            std_error: value.std_error,
            unit: unit.into(),
            value: value.value,
        });
        self
    }

    /// With the standard deviation of a variance in DN², in DN and in electrons.
    fn with_root(self, variance: Value, dn_per_e: Option<f64>) -> Self {
        let Some(root) = variance.sqrt() else { return self };
        let this = self.with("sigma", root, "DN");
        match dn_per_e {
            Some(k) => this.with("sigma_e", root.scaled(1.0 / k), "e-"),
            None => this,
        }
    }

    fn undecided(effect: &'static str, why: &'static str) -> Self {
        Self { undecided: Some(why), ..Self::new(effect, 0.0, "") }
    }
}

/// What levels that change from frame to frame add to errors: of the bias in DN, of dark rates in
/// DN/s and their line at exposure 0 in DN; of the rates of single sites.
#[derive(Clone, Copy, Default)]
struct LevelErrors {
    black: f64,
    rate: f64,
    at_0: f64,
    rate_of_site: f64,
}

impl LevelErrors {
    fn of(data: &Estimates, model: &Estimates) -> Self {
        let [d, m] = [data, model].map(Self::of_one);
        let both = |of: fn(&Self) -> f64| libm::hypot(of(&d), of(&m));
        Self {
            black: both(|e| e.black),
            rate: both(|e| e.rate),
            at_0: both(|e| e.at_0),
            rate_of_site: both(|e| e.rate_of_site),
        }
    }

    fn of_one(e: &Estimates) -> Self {
        let offsets = e.frame_offsets.filter(|o| o.deviation > MIN_OFFSETS);
        let sd = offsets.map_or(0.0, |o| o.sd.value);
        let memory = offsets.and_then(|o| o.drift).map_or(0.0, |d| d.correlation.value);
        let of_site = e.bias.frame_site_variance.map_or(0.0, |v| v.value.max(0.0).sqrt());
        // What independent offsets of sites leave in the mean of all.
        let of_all = of_site / (e.bias.black_by_site.len() as f64).sqrt();
        let mean = |memory: f64| variance_of_mean(e.bias.frames(), memory).sqrt();
        // Lines that scatter have a mean of their own.
        let (width, height) = e.size();
        let lines = e.bias.pattern.columns.value.max(0.0) / width as f64
            + e.bias.pattern.rows.value.max(0.0) / height as f64;
        let black = libm::hypot(sd * mean(memory), lines.sqrt());
        let Some(dark) = &e.dark_current else { return Self { black, ..Self::default() } };
        let [common, of_sites] = [memory, 0.0].map(|memory| dark.errors_of_levels(memory));
        let rate = libm::hypot(sd * common[0], of_all * of_sites[0]);
        // The lines are those of the bias too.
        let of_frames = sd * libm::hypot(common[1], mean(memory));
        let at_0 = libm::hypot(of_frames, of_all * libm::hypot(of_sites[1], mean(0.0)));
        let rate_of_site = of_site * of_sites[0];
        Self { black, rate, at_0, rate_of_site }
    }
}

/// A figure with another error beside its own.
fn widened(v: Value, error: f64) -> Value {
    Value::new(v.value, libm::hypot(v.std_error, error))
}

/// Two figures with their own errors.
fn differs(data: Value, model: Value) -> f64 {
    let error = libm::hypot(data.std_error, model.std_error);
    if error > 0.0 { (data.value - model.value) / error } else { 0.0 }
}

/// A variance above the model's, against the scatter that it has under the model: where the effect
/// is there, its own scatter is larger.
fn exceeds(data: Value, model: Value) -> f64 {
    let error = SQRT_2 * model.std_error;
    if error > 0.0 { (data.value - model.value) / error } else { 0.0 }
}

/// The most deviating of several places.
fn largest(deviations: impl Iterator<Item = f64>) -> f64 {
    let (most, count) = deviations
        .fold((0.0f64, 0), |(most, n), z| (if z.abs() > most.abs() { z } else { most }, n + 1));
    most.signum() * tails::largest(most.abs(), count).max(0.0)
}

/// Whether places differ from the mean of all otherwise than in the model: χ² of the differences
/// about their mean, as a normal deviate.
fn by_site(data: &[Value], model: &[Value]) -> f64 {
    let differences: Vec<Value> = data
        .iter()
        .zip(model)
        .map(|(d, m)| Value::new(d.value - m.value, libm::hypot(d.std_error, m.std_error)))
        .filter(|v| v.std_error > 0.0)
        .collect();
    let dof = differences.len() as f64 - 1.0;
    let Some(mean) = Value::combine(differences.iter().copied()).filter(|_| dof > 0.0) else {
        return 0.0;
    };
    let square = |v: &Value| ((v.value - mean.value) / v.std_error).powi(2);
    tails::chi_square(differences.iter().map(square).sum::<f64>() / dof, dof).max(0.0)
}

const SITES: [&str; 4] = ["site 0,0", "site 1,0", "site 0,1", "site 1,1"];

fn with_sites(mut test: Test, values: &[Value], unit: &str) -> Test {
    if values.len() == SITES.len() {
        for (name, v) in SITES.iter().zip(values) {
            test = test.with(name, *v, unit);
        }
    }
    test
}

/// Every test that the figures allow.
pub(super) fn all(data: &Estimates, model: &Estimates) -> Vec<Test> {
    let mut tests = of_bias(data, model);
    tests.extend(of_darks(data, model));
    tests.extend(of_blinking(data, model));
    tests.extend(of_flats(data, model));
    tests.push(of_areas(data, model));
    tests.push(of_gains(data, model));
    tests
}

/// Of what a sensor does not have.
const NONE: Parts = Parts {
    before: Value { value: 0.0, std_error: 1.0 },
    behind: Value { value: 0.0, std_error: 1.0 },
    at_unity: Value { value: 0.0, std_error: 1.0 },
};

/// Noise and patterns that do not grow with the gain.
fn of_gains(data: &Estimates, model: &Estimates) -> Test {
    let Some((d, m)) = data.behind_gain.zip(model.behind_gain) else {
        let why = "needs dark stacks at two analog gains";
        return Test::undecided("gain-stage", why);
    };
    let all = [
        ("read_noise_behind", d.read_noise, m.read_noise),
        ("row_noise_behind", d.rows, m.rows),
        ("site_offsets_behind", d.sites.unwrap_or(NONE), m.sites.unwrap_or(NONE)),
        ("column_pattern_behind", d.column_pattern, m.column_pattern),
        ("row_pattern_behind", d.row_pattern, m.row_pattern),
        ("pixel_pattern_behind", d.pixel_pattern, m.pixel_pattern),
    ]
    .map(|(name, d, m)| (name, d.behind, differs(d.behind, m.behind)));
    let shown_by = "variances of the bias over the square of the analog gain: what is left of them \
                    at no gain";
    let mut test = Test::new("gain-stage", largest(all.iter().map(|a| a.2)), shown_by);
    for (name, behind, z) in all {
        if let Some(sigma) = behind.sqrt().filter(|_| z > super::MIN_DEVIATION) {
            test = test.with(name, sigma, "DN");
        }
    }
    Test { in_part: true, ..test }
}

fn dn_per_e(data: &Estimates) -> Option<f64> {
    data.gain.map(|g| g.value)
}

/// Of noise that rows have in common, of the captures and of a model, whose error is at least that
/// of none.
fn row_variances(d: &Bias, m: &Bias) -> [Value; 2] {
    [d.row_variance, at_least(m.row_variance, m.row_variance_null)]
}

/// The same of opposite sign in even and odd columns.
fn opposite_row_variances(d: &Bias, m: &Bias) -> [Value; 2] {
    [d.opposite_row_variance, at_least(m.opposite_row_variance, m.row_variance_null)]
}

/// A figure whose error is at least so large.
fn at_least(v: Value, error: f64) -> Value {
    Value::new(v.value, v.std_error.max(error))
}

/// Variances of the pixels' offsets at exposure 0, of captures and a model; where the darks have
/// one exposure, at that.
fn pixel_offsets(data: &Estimates, model: &Estimates) -> [Value; 2] {
    let at_0 = data.pixel_offsets.zip(model.pixel_offsets);
    at_0.map_or([data, model].map(|e| e.bias.pattern.pixels), Into::into)
}

fn of_bias(data: &Estimates, model: &Estimates) -> Vec<Test> {
    let (d, m, k) = (&data.bias, &model.bias, dn_per_e(data));
    // Noise of rows that the model lacks leaves its rest in the mean too.
    let line_null = |i: usize, v: Value| at_least(v, d.pattern.line_nulls[i]);
    let levels = LevelErrors::of(data, model);
    let black = largest(
        d.black_by_site
            .iter()
            .zip(&m.black_by_site)
            .map(|(d, m)| differs(widened(*d, levels.black), *m)),
    );
    let truncated = d.black_by_site.iter().zip(&m.black_by_site).all(|(d, m)| {
        let error = libm::hypot(d.std_error, m.std_error);
        (d.value - m.value + 0.5).abs() < 3.0 * error && error < MAX_CODE_ERROR
    });
    let shown_by = match truncated {
        true => {
            "means of the bias frames; half a code below the model at every site, as of a converter \
             that truncates"
        }
        false => "means of the bias frames",
    };
    let black = Test::new("black-level-offset", black, shown_by);
    let black = match &d.black_by_site[..] {
        [one] => black.with("level", *one, "DN"),
        several => with_sites(black, several, "DN"),
    };
    let variance = |effect, [d, m]: [Value; 2], shown_by| {
        Test::new(effect, exceeds(d, m), shown_by).with_root(d, k)
    };
    let mut tests = vec![
        black,
        Test::new(
            "read-noise",
            differs(d.read_noise_variance, m.read_noise_variance),
            "variance over time of the median pixel of the bias",
        )
        .with_root(d.read_noise_variance, k),
        Test::new(
            "read-noise-spread",
            differs(d.read_noise_spread, m.read_noise_spread),
            "spread over pixels of the logarithm of the noise",
        )
        .with("spread", d.read_noise_spread, "1"),
        variance(
            "row-temporal-noise",
            row_variances(d, m),
            "row means of even times odd columns of the bias",
        ),
        variance(
            "row-noise-of-opposite-sign",
            opposite_row_variances(d, m),
            "row means of even less odd columns of the bias",
        ),
        variance(
            "column-temporal-noise",
            [d.column_variance, m.column_variance],
            "column means of the bias over time",
        ),
        variance(
            "pixel-offset-fpn",
            pixel_offsets(data, model),
            "even times odd frames of the darks at exposure 0, pixel by pixel",
        ),
        variance(
            "column-offset-fpn",
            [d.pattern.columns, line_null(0, m.pattern.columns)],
            "even times odd frames of the bias, means of columns",
        ),
        variance(
            "row-offset-fpn",
            [d.pattern.rows, line_null(1, m.pattern.rows)],
            "even times odd frames of the bias, means of rows",
        ),
    ];
    let slope = largest((0..2).map(|i| differs(d.pattern.slopes[i], m.pattern.slopes[i])));
    let slope = Test::new("offset-slope", slope, "straight slope over the lines of the bias")
        .with("left_to_right", d.pattern.slopes[0], "DN")
        .with("top_to_bottom", d.pattern.slopes[1], "DN");
    tests.push(Test { in_part: true, ..slope });
    if let (Some(d), Some(m)) = (d.frame_site_variance, m.frame_site_variance) {
        let shown_by = "means of the sites of the bias frames over time";
        tests.push(variance("frame-offset-by-site", [d, m], shown_by));
    }
    if let (Some(d), Some(m)) = (data.frame_offsets, model.frame_offsets) {
        // There is no less than none.
        let z = (d.deviation.max(0.0) - m.deviation.max(0.0)) / SQRT_2;
        let test =
            |shown_by| Test::new("frame-offset-noise", z, shown_by).with("sigma", d.sd, "DN");
        tests.push(match d.drift {
            None => test("means of the dark frames over time"),
            Some(drift) => {
                let memory = drift.correlation.value;
                let ln = -libm::log(memory.max(f64::MIN_POSITIVE));
                let error = drift.correlation.std_error / (memory * ln * ln);
                test("means of the dark frames over time, each near the one before")
                    .with("correlation", drift.correlation, "1")
                    .with("time_constant", Value::new(1.0 / ln, error), "frames")
            }
        });
    }
    tests
}

fn of_darks(data: &Estimates, model: &Estimates) -> Vec<Test> {
    let (Some(d), Some(m)) = (&data.dark_current, &model.dark_current) else {
        let why = "needs dark stacks of two exposures above 0";
        return vec![Test::undecided("dark-current", why), Test::undecided("hot-pixels", why)];
    };
    let k = dn_per_e(data);
    let in_e = |test: Test, v: Value| match k {
        Some(k) => test.with("median_e", v.scaled(1.0 / k), "e-/s"),
        None => test,
    };
    let levels = LevelErrors::of(data, model);
    let median = widened(d.median, levels.rate);
    let rate = Test::new(
        "dark-current",
        differs(median, m.median),
        "means of the dark stacks over exposure, the median pixel",
    )
    .with("median", median, "DN/s");
    let pixels = (data.size().0 * data.size().1) as f64;
    let hot = (d.hot_share.value - m.hot_share.value) * pixels
        / ((d.hot_share.value + m.hot_share.value) * pixels + 1.0).sqrt();
    let hot = Test::new("hot-pixels", hot, "pixels above the median by six widths of the core")
        .with("share", d.hot_share, "1");
    let hot = match d.hot_excess {
        Some(excess) => hot.with("mean_excess", excess, "DN/s"),
        None => hot,
    };
    let by_site = Test::new(
        "dark-current-by-site",
        by_site(&rates_by_site(data, model), &m.median_by_site),
        "median rates of the sites less their mean",
    );
    vec![
        in_e(rate, median),
        with_sites(by_site, &d.median_by_site, "DN/s"),
        Test::new(
            "dark-current-spread",
            differs(d.variance_within_sites, m.variance_within_sites),
            "lower half of the pixels' rates about those of their sites",
        )
        .with_root(d.variance_within_sites, k),
        Test { in_part: true, ..hot },
        Test::new(
            "black-level-over-exposure",
            differs(widened(d.intercept_above_bias, levels.at_0), m.intercept_above_bias),
            "level of the dark stacks' line at exposure 0, less the bias",
        )
        .with("step", d.intercept_above_bias, "DN"),
    ]
}

/// The captures' rates of sites, with errors from offsets of sites in both.
fn rates_by_site(data: &Estimates, model: &Estimates) -> Vec<Value> {
    let error = LevelErrors::of(data, model).rate_of_site;
    let rates = data.dark_current.iter().flat_map(|d| &d.median_by_site);
    rates.map(|v| widened(*v, error)).collect()
}

/// The share of pixels that pass [`NOISY`] where ln of the noise is normal over pixels, by the
/// trapezoidal rule.
fn noisy_by_spread(spread: f64, dof: f64) -> f64 {
    const STEPS: i32 = 120;
    let limit = tails::quantile_of_squares(NOISY, dof) * tails::median_of_squares(dof);
    let at = |i: i32| {
        let u = f64::from(i) * 12.0 / f64::from(STEPS) - 6.0;
        let z = tails::chi_square(limit * libm::exp(-2.0 * spread * u), dof);
        [libm::exp(-0.5 * u * u), libm::exp(-0.5 * u * u + tails::ln_upper(z))]
    };
    let [all, above] = (0..=STEPS).map(at).fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    above / all
}

fn of_blinking(data: &Estimates, model: &Estimates) -> Vec<Test> {
    let pixels = (data.size().0 * data.size().1) as f64;
    let frames = data.bias.frames() as f64;
    let noisy = data.bias.noisy_share;
    // A spread at the upper end of what is known of it.
    let spread = data.bias.read_noise_spread;
    let expected = noisy_by_spread(spread.value + 2.0 * spread.std_error, frames - 1.0)
        .max(model.bias.noisy_share.value);
    let z = (noisy.value - expected).max(0.0) * pixels / (expected * pixels + 1.0).sqrt();
    let read_out = Test::new(
        "random-telegraph-noise",
        z,
        "pixels of the bias with more noise than the spread over pixels explains",
    )
    .with("share", noisy, "1");
    let blinking = "dark-current-telegraph-noise";
    let Some((share, seen)) = data.telegraph.share.zip(model.telegraph.share) else {
        return vec![read_out, Test::undecided(blinking, "needs exposed dark stacks")];
    };
    let (count, by_chance) = (share.value * pixels, seen.value * pixels);
    let law = data.telegraph.chosen_in_longest.as_ref().and_then(|l| l.exponent);
    let grows = law.is_some_and(|p| p.value > 0.5);
    let z = (count - by_chance) / (by_chance + 0.25).sqrt().max(1.0);
    let z = if grows { z } else { 0.0 };
    if count < MIN_PIXELS && BLINKING_SHARE * pixels < MIN_PIXELS {
        let why = "not decidable at this size: too few pixels for a share of 0.02 %";
        return vec![read_out, Test::undecided(blinking, why).with("share", share, "1")];
    }
    if grows && (1.0..MIN_PIXELS).contains(&count.round()) {
        let why = "not decidable at this size: fewer than five pixels stand out";
        return vec![read_out, Test::undecided(blinking, why).with("share", share, "1")];
    }
    let mut dark = Test::new(
        blinking,
        z,
        "pixels whose noise stands out in two long dark stacks and grows with exposure",
    )
    .with("share", share, "1");
    if let (Some(p), Some(jump)) = (law, data.telegraph.median_jump) {
        dark = dark.with("exponent", p, "1").with("median_jump", jump, "DN/s");
    }
    vec![read_out, Test { in_part: true, ..dark }]
}

fn of_flats(data: &Estimates, model: &Estimates) -> Vec<Test> {
    let pairs = || data.flats.iter().zip(&model.flats);
    let Some((brightest, of_model)) = pairs().max_by(|a, b| a.0.level().total_cmp(&b.0.level()))
    else {
        let kinds = [
            "system-gain",
            "prnu",
            "prnu-correlated",
            "flicker-banding",
            "light-flicker",
            "defective-columns",
            "charge-transfer-inefficiency",
        ];
        return kinds.map(|kind| Test::undecided(kind, "needs flats")).into_iter().collect();
    };
    let mut tests = Vec::new();
    if let Some((d, m)) = data.gain.zip(model.gain) {
        let shown_by = "variance over mean of the flats";
        let moved = brightest.level() / of_model.level() - 1.0;
        let ratio = d.over(m).value - 1.0;
        // A gain moves the mean as much as variance over mean. Non-linearity, coupling and defects
        // bend the variance, and light that was fitted to the means leaves them where they are.
        let alone = moved.abs() < MIN_MOVED * ratio.abs();
        tests.push(match alone && differs(d, m).abs() >= super::MIN_DEVIATION {
            true => Test::undecided(
                "system-gain",
                "variance over mean of the flats is another, the mean is not: not shown to be the \
                 gain",
            )
            .with("gain", d, "DN/e-"),
            false => Test::new("system-gain", differs(d, m), shown_by).with("gain", d, "DN/e-"),
        });
    }
    let gains = |f: &Flat| f.sites.iter().map(|s| s.gain).collect::<Vec<_>>();
    let gain = Test::new(
        "gain-by-site",
        by_site(&gains(brightest), &gains(of_model)),
        "variance over mean of each site of the brightest flat",
    );
    tests.push(with_sites(gain, &gains(brightest), "DN/e-"));
    tests.extend(of_prnu(data, model));
    tests.extend(of_light(brightest, of_model, data));
    let [count, given] = [brightest, of_model].map(|f| f.defective_columns.len() as f64);
    let deviation = if count > given { 2.0 * MIN_PIXELS } else { 0.0 };
    let shown_by = "median gain of columns of the brightest flat";
    let mut columns = Test::new("defective-columns", deviation, shown_by).with(
        "columns",
        Value::new(count, 0.0),
        "1",
    );
    for x in brightest.defective_columns.iter().take(MAX_LISTED) {
        columns = columns.with("column", Value::new(*x as f64, 0.0), "px");
    }
    if let Some(gain) = brightest.defective_gain {
        columns = columns.with("gain", gain, "1");
    }
    tests.push(columns);
    let [d, m] = [brightest, of_model].map(|f| f.transfer_inefficiency);
    let stay = d.into_iter().zip(m).map(|(d, m)| Some((d?, m?)));
    let Some(stay) = stay.collect::<Option<Vec<_>>>() else {
        let why = "needs flats whose noise is mostly that of light";
        tests.push(Test::undecided("charge-transfer-inefficiency", why));
        return tests;
    };
    let shown_by = "correlation of neighbours in the noise of the brightest flat, its slope over \
                    columns and rows";
    let z = largest(stay.iter().map(|(d, m)| differs(*d, *m)));
    let test = Test::new("charge-transfer-inefficiency", z, shown_by);
    tests.push(test.with("serial", stay[0].0, "1").with("parallel", stay[1].0, "1"));
    tests
}

/// The variance of `prnu`, of the captures and a model: of the brightest flat; where neighbours
/// share a part in one of the two, the other part over all flats.
fn prnu_variances(both: [&Estimates; 2]) -> Option<[Value; 2]> {
    let parts = both.map(|e| e.prnu);
    let shares = |p: &Prnu| p.deviation() >= super::MIN_DEVIATION;
    let own = parts.iter().flatten().any(shares);
    let of = |e: &Estimates| match own {
        true => e.prnu.map(|p| p.own()),
        false => Value::combine(brightest(e)?.sites.iter().map(|s| s.prnu_variance)),
    };
    let [d, m] = both.map(of);
    Some([d?, m?])
}

/// Of the pixels' gains: each for itself, and what neighbours share.
fn of_prnu(data: &Estimates, model: &Estimates) -> Vec<Test> {
    let mut tests = Vec::new();
    if let Some([d, m]) = prnu_variances([data, model]) {
        let shown_by = "even times odd frames of the brightest flat, without what is smooth";
        let test = match d.sqrt() {
            Some(sigma) => Test::new("prnu", differs(d, m), shown_by).with("sigma", sigma, "1"),
            None => Test::new("prnu", 0.0, shown_by),
        };
        let sites = brightest(data).map_or(&[][..], |f| &f.sites);
        let roots: Vec<Value> = sites.iter().filter_map(|s| s.prnu_variance.sqrt()).collect();
        tests.push(with_sites(test, &roots, "1"));
    }
    if let Some((d, m)) = data.prnu.zip(model.prnu) {
        let shown_by = "even times odd frames of all flats, at neighbours to the right, below and \
                        diagonally below";
        let test = Test::new("prnu-correlated", d.less(&m).deviation(), shown_by);
        tests.push(match d.shared().sqrt() {
            Some(sigma) => test.with("sigma", sigma, "1"),
            None => test,
        });
    }
    tests
}

fn brightest(e: &Estimates) -> Option<&Flat> {
    e.flats.iter().max_by(|a, b| a.level().total_cmp(&b.level()))
}

/// The site with the least.
fn lowest(sites: &[Value]) -> Value {
    let least = |a: Value, b: Value| if b.value < a.value { b } else { a };
    sites.iter().copied().fold(Value::new(f64::INFINITY, 0.0), least)
}

/// Areas that do not respond as the rest in the brightest flat, and those with more dark current.
struct Areas<'a> {
    dead: &'a [Area],
    hot: &'a [Area],
}

fn areas(e: &Estimates) -> Areas<'_> {
    Areas {
        dead: brightest(e).map_or(&[], |f| &f.defective_areas),
        hot: e.dark_current.as_ref().map_or(&[], |d| &d.hot_areas),
    }
}

fn of_areas(data: &Estimates, model: &Estimates) -> Test {
    let (d, m) = (areas(data), areas(model));
    let count = |a: &Areas<'_>| a.dead.len() + a.hot.len();
    let deviation = if count(&d) > count(&m) { 2.0 * MIN_PIXELS } else { 0.0 };
    let shown_by = "rows, and pixels that touch, whose gain in the brightest flat or whose dark rate \
                    stands out together";
    let mut test = Test::new("defective-areas", deviation, shown_by);
    let exactly = |n: usize| Value::new(n as f64, 0.0);
    for (areas, value, unit) in [(d.dead, "gain", "1"), (d.hot, "rate", "DN/s")] {
        for area in areas.iter().take(MAX_LISTED) {
            test = test
                .with("left", exactly(area.left), "px")
                .with("top", exactly(area.top), "px")
                .with("width", exactly(area.width), "px")
                .with("height", exactly(area.height), "px")
                .with(value, area.value, unit);
        }
    }
    test
}

/// An effect for the dead rows, the dead clusters, the hot rows and the hot clusters, each of the
/// mean size and value.
fn of_groups(
    areas: &Areas<'_>,
    data: &Estimates,
    dn_per_e: f64,
    given: Given,
    camera: &Camera,
) -> Option<Proposal> {
    let columns = data.size().0;
    let whole = |a: &&Area| a.width == columns;
    let group = |areas: Vec<&Area>, is_hot: bool| {
        let first = areas.first()?;
        let n = areas.len() as f64;
        let mean = |of: &dyn Fn(&Area) -> f64| areas.iter().map(|a| of(a)).sum::<f64>() / n;
        let width = if whole(first) { 0.0 } else { mean(&|a| a.width as f64).round() };
        let error = areas.iter().map(|a| a.value.std_error).fold(0.0, f64::max) / n.sqrt();
        let value = Value::new(mean(&|a| a.value.value), error);
        let mut law = vec![
            ("count", Value::chosen(n)),
            ("width_px", Value::chosen(width)),
            ("height_px", Value::chosen(mean(&|a| a.height as f64).round())),
        ];
        if is_hot {
            law.push(("gain", Value::chosen(1.0)));
            law.push(("rate_e_per_s", value.scaled(1.0 / dn_per_e)));
            law.push(("doubling_c", Value::chosen(camera.sensor.noise.dark_doubling_c)));
            law.push(("reference_c", Value::chosen(given.temperature_c)));
        } else {
            law.push(("gain", Value::new(value.value.max(0.0), value.std_error)));
        }
        Proposal::of("defective-areas", 2.0 * MIN_PIXELS, law)
    };
    let mut all =
        [(areas.dead, false), (areas.hot, true)].into_iter().flat_map(|(areas, is_hot)| {
            let (rows, clusters): (Vec<&Area>, Vec<&Area>) = areas.iter().partition(whole);
            [group(rows, is_hot), group(clusters, is_hot)].into_iter().flatten()
        });
    let mut first = all.next()?;
    for other in all {
        first.effects.extend(other.effects);
        first.beside = true;
    }
    Some(first)
}

/// The effect of the catalogue that a test's is a part of.
pub(super) fn kind(effect: &'static str) -> &'static str {
    match effect {
        "row-noise-of-opposite-sign" => "row-temporal-noise",
        "flicker-by-site" => "flicker-banding",
        "gain-stage" => "read-noise",
        _ => effect,
    }
}

/// Whether an effect is seen only in part, by as much as the model with it shows.
pub(super) fn is_seen_in_part(effect: &str) -> bool {
    matches!(effect, "dark-current-telegraph-noise" | "read-noise-spread")
}

/// Light that changes over rows and from frame to frame.
fn of_light(d: &Flat, m: &Flat, data: &Estimates) -> Vec<Test> {
    let mut by_rows = 0.0;
    let mut tests = Vec::new();
    let shown_by = "waves of the row means of the brightest flat; one exposure shows frequency x \
                    line time, not each: flats of another exposure tell them apart";
    let seen = d.flicker.fit.filter(|_| d.flicker.power_ratio > MIN_POWER);
    if let Some([frequency, depth]) = seen {
        let x = std::f64::consts::PI * frequency.value * data.size().1 as f64;
        by_rows = 0.5 * (depth.value * libm::sin(x) / x).powi(2);
        let given = m.flicker.fit.filter(|_| m.flicker.power_ratio > MIN_POWER);
        let z = given.map_or(depth.z(), |[_, given]| differs(depth, given));
        let test = Test::new("flicker-banding", z, shown_by)
            .with("cycles_per_row", frequency, "1/row")
            .with("depth_after_exposure", depth, "1")
            .with("line_time_at_100_hz", frequency.scaled(1e6 / FLICKER_HZ), "us")
            .with("depth_at_100_hz", depth.scaled(1.0 / left_by(d.exposure_s, FLICKER_HZ)), "1")
            .with("line_time_at_120_hz", frequency.scaled(1e6 / OTHER_HZ), "us")
            .with("depth_at_120_hz", depth.scaled(1.0 / left_by(d.exposure_s, OTHER_HZ)), "1");
        tests.push(Test { in_part: true, ..test });
        tests.push(flicker_by_site(&d.flicker.by_site, &m.flicker.by_site));
    } else {
        tests.push(Test::new("flicker-banding", 0.0, shown_by));
    }
    let squared = |v: Value| Value::new(v.value * v.value, 2.0 * v.value * v.std_error);
    let lamp = squared(d.frame_sd);
    // The waves that a frame cuts off change its mean too, and so does its offset, as far as that
    // is known.
    let offsets = data.frame_offsets.filter(|o| o.deviation > MIN_OFFSETS);
    let offsets = offsets.map_or(0.0, |o| (o.sd.value / d.level()).powi(2));
    let other = 2.0 * (by_rows + offsets);
    let lamp = Value::new(lamp.value - other, lamp.std_error + other);
    let shown_by = "means of the frames of the brightest flat over time";
    let test = Test::new(
        "light-flicker",
        exceeds(
            lamp,
            Value {
                std_error: squared(m.frame_sd).std_error + 0.5 * other,
                ..squared(m.frame_sd)
            },
        ),
        shown_by,
    );
    tests.push(test.with("sigma", d.frame_sd, "1"));
    tests
}

/// Waves of sites otherwise than in the model; of one without flicker they are alike.
fn flicker_by_site(data: &[Wave], model: &[Wave]) -> Test {
    let depths = |waves: &[Wave]| waves.iter().map(|w| w.depth).collect::<Vec<_>>();
    let lags = |waves: &[Wave]| waves.iter().map(|w| w.lag_deg).collect::<Vec<_>>();
    let against = |of: &dyn Fn(&[Wave]) -> Vec<Value>, none: f64| match model {
        [] => by_site(&of(data), &vec![Value::new(none, 0.0); data.len()]),
        model => by_site(&of(data), &of(model)),
    };
    let z = largest([against(&depths, 1.0), against(&lags, 0.0)].into_iter());
    let shown_by = "waves of each site's row means against those of all: amplitude and phase";
    let mut test = Test::new("flicker-by-site", z, shown_by);
    test = with_sites(test, &depths(data), "1");
    if data.len() == SITES.len() {
        for (site, lag) in SITES.iter().zip(lags(data)) {
            test = test.with(&format!("lag of {site}"), lag, "deg");
        }
    }
    test
}

/// The flicker's parameters of the four places of a 2x2 pattern: depths, and lags behind the first.
fn of_places(sites: &[Wave]) -> Option<[(&'static str, Value); 7]> {
    let [first, b, c, d] = sites else { return None };
    let lag = |w: &Wave| {
        let error = libm::hypot(w.lag_deg.std_error, first.lag_deg.std_error);
        Value::new(w.lag_deg.value - first.lag_deg.value, error)
    };
    Some([
        ("plane_0", first.depth),
        ("plane_1", b.depth),
        ("plane_2", c.depth),
        ("plane_3", d.depth),
        ("plane_1_lag_deg", lag(b)),
        ("plane_2_lag_deg", lag(c)),
        ("plane_3_lag_deg", lag(d)),
    ])
}

/// What an exposure leaves of the depth of light that flickers; 1 where it leaves nothing.
fn left_by(exposure_s: f64, frequency_hz: f64) -> f64 {
    let left = sinc(frequency_hz * exposure_s).abs();
    if left > 1e-3 { left } else { 1.0 }
}

/// Of twice the frequencies of the mains that of which the exposure leaves more: an exposure of
/// whole periods of the other shows none of it.
fn likelier_hz(exposure_s: f64) -> f64 {
    let left = |hz: f64| sinc(hz * exposure_s).abs();
    if left(OTHER_HZ) > left(FLICKER_HZ) { OTHER_HZ } else { FLICKER_HZ }
}

/// The effect of the catalogue with what a test gives of its parameters: what the model has, plus
/// the difference of the figures, each in electrons by its own gain.
pub(super) fn proposal(
    test: &Test,
    data: &Estimates,
    model: &Estimates,
    camera: &Camera,
    given: Given,
) -> Option<Proposal> {
    let kind = kind(test.effect);
    let present = |key: &str| -> Option<f64> {
        let effect = current(camera, kind)?;
        let at = effect.entry().parameters.iter().position(|p| p.key == key)?;
        effect.values().get(at).copied().map(f64::from)
    };
    let gain_of_model = model.gain.unwrap_or(Value::new(given.dn_per_e, 0.0));
    let gain = data.gain.unwrap_or(gain_of_model);
    let strength = test.deviation.abs();
    // σ² = σ₀² + what the captures have more than the model.
    let root = |key: &str, d: Value, m: Value, unit: [Value; 2]| {
        let had = Value::new(present(key).unwrap_or(0.0).powi(2), 0.0);
        (had + d.over(unit[0].squared()) - m.over(unit[1].squared())).sqrt()
    };
    let sigma = |key: &'static str, d: Value, m: Value, unit: [Value; 2]| {
        Proposal::of(kind, strength, [(key, root(key, d, m, unit)?)])
    };
    // Noise in e⁻ that may lie behind the gain.
    let at_place = |mut law: Vec<(&'static str, Value)>, is_behind: bool| {
        if is_behind {
            let sigmas = law.iter_mut().filter(|(key, _)| key.ends_with("_e"));
            sigmas.for_each(|(_, sigma)| *sigma = sigma.scaled(given.analog_gain));
            law.push(("gain_exponent", Value::chosen(-1.0)));
        }
        Proposal::of(kind, strength, law)
    };
    let per_e = [gain, gain_of_model];
    let (d, m) = (&data.bias, &model.bias);
    match test.effect {
        "read-noise" => sigma("read_e", d.read_noise_variance, m.read_noise_variance, per_e),
        "gain-stage" => {
            let (d, m) = (data.behind_gain?.read_noise, model.behind_gain?.read_noise);
            (differs(d.behind, m.behind) > super::MIN_DEVIATION).then_some(())?;
            let unity = per_e.map(|k| k.scaled(given.analog_gain.recip()));
            let all = root("read_e", d.at_unity, m.at_unity, unity)?;
            let post = root("read_e_post", d.behind, m.behind, unity);
            // The part is at most the whole.
            let post = post.map_or(Value::new(0.0, all.std_error), |post| {
                Value::new(post.value.min(all.value), post.std_error)
            });
            let law = [("read_e", all), ("read_e_post", post)];
            Proposal::of(kind, strength, law)
        }
        "frame-offset-by-site" => {
            let parts = data.behind_gain.and_then(|b| b.sites);
            let is_behind = parts.is_some_and(|p| p.is_behind());
            let (d, m) = (d.frame_site_variance?, m.frame_site_variance?);
            at_place(vec![("sigma_e", root("sigma_e", d, m, per_e)?)], is_behind)
        }
        "row-temporal-noise" | "row-noise-of-opposite-sign" => {
            let all =
                [("sigma_e", row_variances(d, m)), ("opposite_e", opposite_row_variances(d, m))];
            // Both parts of one effect, each where it stands out or the model has it.
            let is_there = |key, [d, m]: [Value; 2]| {
                present(key).is_some_and(|had| had > 0.0) || exceeds(d, m) >= super::MIN_DEVIATION
            };
            let none = Value::new(0.0, 0.0);
            let part = |(key, [d, m]): (&'static str, [Value; 2])| match is_there(key, [d, m]) {
                true => Some((key, root(key, d, m, per_e).unwrap_or(none))),
                false => (key == "sigma_e").then_some((key, none)),
            };
            let law = all.into_iter().filter_map(part).collect();
            at_place(law, data.behind_gain.is_some_and(|b| b.rows.is_behind()))
        }
        "column-temporal-noise" => sigma("sigma_e", d.column_variance, m.column_variance, per_e),
        "pixel-offset-fpn" => {
            let [d, m] = pixel_offsets(data, model);
            sigma("sigma_e", d, m, per_e)
        }
        "column-offset-fpn" => sigma("sigma_e", d.pattern.columns, m.pattern.columns, per_e),
        "row-offset-fpn" => sigma("sigma_e", d.pattern.rows, m.pattern.rows, per_e),
        "read-noise-spread" => {
            // Rounding and noise of rows dilute it.
            let seen = present("spread").filter(|_| m.read_noise_spread.value > 0.0);
            let part = seen.map_or(1.0, |had| had / m.read_noise_spread.value);
            Proposal::of(test.effect, strength, [("spread", d.read_noise_spread.scaled(part))])
        }
        "frame-offset-noise" => {
            let offsets = data.frame_offsets?;
            let mut law = vec![("sigma_e", offsets.sd.over(gain))];
            law.extend(offsets.drift.map(|d| {
                let of = d.correlation;
                ("correlation", Value::new(of.value.min(MAX_CORRELATION), of.std_error))
            }));
            at_place(law, data.behind_gain.is_some_and(|b| b.frames_are_behind))
        }
        "prnu" | "prnu-correlated" => {
            let [d, m] = match test.effect {
                "prnu" => prnu_variances([data, model])?,
                _ => [data.prnu?.shared(), model.prnu?.shared()],
            };
            sigma("sigma", d, m, [Value::new(1.0, 0.0); 2])
        }
        "system-gain" => {
            let ratio = data.gain?.over(model.gain?);
            let had = present("ratio").unwrap_or(1.0);
            Proposal::of(test.effect, strength, [("ratio", ratio.scaled(had))])
        }
        "dark-current" | "dark-current-spread" => {
            let (d, m) = (data.dark_current.as_ref()?, model.dark_current.as_ref()?);
            let noise = &camera.sensor.noise;
            let kelvins = given.temperature_c - noise.temperature_ref_c;
            let growth = libm::exp2(kelvins / noise.dark_doubling_c);
            let more = |d: Value, m: Value| d.over(gain) - m.over(gain_of_model);
            // Sites of their own rates have what is above the lowest as an effect of their own.
            let sites = by_site(&rates_by_site(data, model), &m.median_by_site);
            let (median_d, median_m) = match sites.abs() {
                z if z < super::MIN_DEVIATION => (d.median, m.median),
                _ => (lowest(&d.median_by_site), m.median),
            };
            let had = Value::new(noise.dark_current_e_per_s, 0.0);
            let mean = had + more(median_d, median_m).scaled(growth.recip());
            let mean = Value::new(mean.value.max(0.0), mean.std_error);
            // As it is, not by what the model has: of one far too wide, half the rates are cut at 0.
            let spread = d.variance_within_sites.sqrt().unwrap_or(Value::new(0.0, 0.0));
            let spread = spread.over(gain).scaled(growth.recip());
            Proposal::of(
                "dark-current",
                strength,
                [
                    ("mean_e_per_s", mean),
                    ("dsnu_e_per_s", spread),
                    ("doubling_c", Value::chosen(noise.dark_doubling_c)),
                    ("reference_c", Value::chosen(noise.temperature_ref_c)),
                ],
            )
        }
        "dark-current-by-site" => {
            let (d, m) = (data.dark_current.as_ref()?, model.dark_current.as_ref()?);
            let noise = &camera.sensor.noise;
            let kelvins = given.temperature_c - noise.temperature_ref_c;
            let growth = libm::exp2(kelvins / noise.dark_doubling_c);
            let least = lowest(&d.median_by_site);
            let keys =
                ["plane_0_e_per_s", "plane_1_e_per_s", "plane_2_e_per_s", "plane_3_e_per_s"];
            (d.median_by_site.len() == keys.len() && m.median_by_site.len() == keys.len())
                .then_some(())?;
            let above = |v: &Value| {
                let above = Value::new(v.value - least.value, v.std_error);
                above.over(gain).scaled(growth.recip())
            };
            let mut law: Vec<(&str, Value)> =
                keys.into_iter().zip(d.median_by_site.iter().map(above)).collect();
            law.push(("doubling_c", Value::chosen(noise.dark_doubling_c)));
            law.push(("reference_c", Value::chosen(noise.temperature_ref_c)));
            Proposal::of(kind, strength, law)
        }
        "defective-areas" => of_groups(&areas(data), data, gain.value, given, camera),
        "charge-transfer-inefficiency" => {
            let [serial, parallel] = brightest(data)?.transfer_inefficiency;
            let [serial, parallel] = [serial?, parallel?];
            let not_below_0 = |v: Value| Value::new(v.value.max(0.0), v.std_error);
            let law = [("serial", not_below_0(serial)), ("parallel", not_below_0(parallel))];
            Proposal::of(test.effect, strength, law)
        }
        "hot-pixels" => {
            let d = data.dark_current.as_ref()?;
            let mean = d.hot_excess?;
            // Of an exponential law the excess over a limit has the law's mean.
            let below = libm::exp((d.hot_threshold - d.median.value) / mean.value);
            let fraction = d.hot_share.scaled(below);
            let rate = mean.over(gain);
            Proposal::of(test.effect, strength, [("fraction", fraction), ("mean_e_per_s", rate)])
        }
        "dark-current-telegraph-noise" => {
            let of = |e: &Estimates| Some((e.telegraph.share?, e.telegraph.median_jump?));
            let (share, jump) = of(data)?;
            // The median of an exponential law is ln 2 of its mean.
            let had = present("fraction").zip(present("mean_e_per_s"));
            let [part, unit] = match (had, of(model)) {
                (Some((fraction, mean)), Some((seen, median))) if seen.value > 0.0 => {
                    [fraction / seen.value, mean / median.value]
                }
                _ => [1.0, 1.0 / (gain.value * std::f64::consts::LN_2)],
            };
            let noise = &camera.sensor.noise;
            Proposal::of(
                test.effect,
                strength,
                [
                    ("fraction", share.scaled(part)),
                    ("mean_e_per_s", jump.scaled(unit)),
                    ("renewal", Value::chosen(RENEWAL)),
                    ("doubling_c", Value::chosen(noise.dark_doubling_c)),
                    ("reference_c", Value::chosen(given.temperature_c)),
                ],
            )
        }
        "defective-columns" => {
            let brightest = brightest(data)?;
            let width = data.size().0 as f64;
            let count = brightest.defective_columns.len() as f64;
            let fraction = Value::new(count / width, count.sqrt() / width);
            let law = [("fraction", fraction), ("gain", brightest.defective_gain?)];
            Proposal::of(test.effect, strength, law)
        }
        "flicker-banding" | "flicker-by-site" => {
            let brightest = brightest(data)?;
            let [frequency, depth] = brightest.flicker.fit?;
            let hz = likelier_hz(brightest.exposure_s);
            let mut law = vec![
                ("depth", depth.scaled(1.0 / left_by(brightest.exposure_s, hz))),
                ("frequency_hz", Value::chosen(hz)),
                ("row_time_us", frequency.scaled(1e6 / hz)),
            ];
            if test.effect == "flicker-by-site" {
                law.extend(of_places(&brightest.flicker.by_site)?);
            }
            Proposal::of(kind, strength, law)
        }
        "black-level-offset" => {
            let off: Vec<f64> = d
                .black_by_site
                .iter()
                .zip(&m.black_by_site)
                .map(|(d, m)| d.value - m.value)
                .collect();
            let mean = off.iter().sum::<f64>() / off.len() as f64;
            let error = d.black_by_site[0].std_error;
            let keys = ["plane_0_dn", "plane_1_dn", "plane_2_dn", "plane_3_dn"];
            let value = |key, more: f64| Value::new(present(key).unwrap_or(0.0) + more, error);
            let mut parameters = vec![("offset_dn", value("offset_dn", mean))];
            if off.len() == keys.len() {
                parameters.extend(keys.iter().zip(&off).map(|(k, o)| (*k, value(k, o - mean))));
            }
            Proposal::of(test.effect, strength, parameters)
        }
        _ => None,
    }
}
