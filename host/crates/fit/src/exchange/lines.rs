//! Lines of noise over the system gain, of ELD and PMN.

use super::imported::{Beside, Imported, number, numbers};
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_linear::{LeastSquares, Matrix, Vector};
use camrig_sensor_core::effects::Effect;
use serde_json::{Value as Json, json};

/// Least shape of Tukey's law that a camera file takes.
const MIN_LAMBDA: f64 = -0.22;
/// Gains at which a camera is described.
const PLACES: usize = 9;

/// A standard deviation in DN over the system gain: ln σ = slope ln K + offset, with a scatter.
#[derive(Clone, Copy, Debug)]
struct Line {
    slope: f64,
    offset: f64,
    scatter: f64,
}

impl Line {
    fn at(&self, k: f64) -> f64 {
        libm::exp(self.slope * libm::log(k) + self.offset)
    }
}

/// Whose file it is.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum By {
    /// `Profile-1` with `g_scale`, `G_scale`, `R_scale`; `G_shape`; Kmin and Kmax in DN/e⁻.
    Eld,
    /// `sigGsk`, `sigGsb`, ...; Kmin and Kmax are ln K.
    Pmn,
}

impl By {
    fn name(self) -> &'static str {
        match self {
            Self::Eld => "ELD",
            Self::Pmn => "PMN",
        }
    }

    /// A line, under the name that each gives it; none where it has no such line.
    fn line(self, json: &Json, [eld, pmn]: [&str; 2]) -> Option<Line> {
        let (own, [slope, bias, sigma]) = match self {
            Self::Eld => (&json["Profile-1"][eld], ["slope", "bias", "sigma"].map(String::from)),
            Self::Pmn => (json, ["k", "b", "sig"].map(|end| format!("{pmn}{end}"))),
        };
        let of = |key: &str| number(&own[key]);
        let scatter = of(&sigma).unwrap_or(0.0);
        Some(Line { slope: of(&slope)?, offset: of(&bias)?, scatter })
    }
}

/// Reads parameters of ELD, as JSON, or of PMN.
pub(super) fn read(json: &Json, by: By, beside: &Beside) -> Result<Imported> {
    let from = by.name();
    let get = |key: &str| number(&json[key]);
    let ends = get("Kmin").zip(get("Kmax"));
    let ends = ends.map(|(low, high)| match by {
        By::Eld => [low, high],
        By::Pmn => [libm::exp(low), libm::exp(high)],
    });
    let [low, high] = ends.filter(|[low, high]| 0.0 < *low && low < high).ok_or_else(|| {
        Error::input(format!("no range of the system gain in a file of {from}"))
            .help("Kmin < Kmax: DN per electron above 0 of ELD, their logarithms of PMN")
    })?;
    let own_bits = get("wp").map(|white| libm::ceil(libm::log2(white + 1.0)));
    let bits = own_bits.map_or_else(|| beside.bits("no white level (wp)"), Ok)?;
    let mut found = Imported::default();
    found.add("sensor.bits", bits as i64, from);
    found.add("sensor.full_well_e", (libm::exp2(bits) - 1.0) / low, from);
    if let Some(black) = get("bl") {
        found.add("sensor.black_level_dn", black, from);
    }
    found.add("sensor.noise.read_e_post", 0.0, from);
    let shape = match by {
        By::Eld => numbers(&json["G_shape"]).and_then(|all| of_many(&all, &mut found)),
        By::Pmn => get("lam"),
    };
    if let By::Eld = by {
        let left = ["Profile-2", "color_bias"].into_iter().filter(|key| json.get(*key).is_some());
        found.notes.extend(left.map(|key| format!("{key} is left out")));
    }
    let mut lines = Vec::new();
    let (tail, plain) = (by.line(json, ["G_scale", "sigTL"]), by.line(json, ["g_scale", "sigGs"]));
    match (tail, shape, plain) {
        (Some(tail), Some(lambda), _) => {
            let kept = lambda.max(MIN_LAMBDA);
            if kept != lambda {
                found.notes.push(format!(
                    "lambda {lambda} is beyond {MIN_LAMBDA}: that is written, with the standard \
                     deviation of the former; the farthest tails are lighter"
                ));
            }
            let sd = tukey_sd(lambda)?;
            found.add("sensor.noise.read_e", 0.0, from);
            let effect = "effect.heavy-tailed-read-noise";
            found.add(&format!("{effect}.sigma_e"), tail.at(low) * sd / low, from);
            found.add(&format!("{effect}.lambda"), kept, from);
            found.add(&format!("{effect}.gain_exponent"), tail.slope - 1.0, from);
            lines.push(tail);
        }
        (_, _, Some(read)) => {
            let read_e = |k: f64| read.at(k) / k;
            found.add("sensor.noise.read_e", read_e(low), from);
            found.add("sensor.gains.at", vec![1.0, high / low], from);
            found.add("sensor.gains.read_e", vec![read_e(low), read_e(high)], from);
            lines.push(read);
        }
        _ => {
            return Err(Error::input("no line of the read noise")
                .help("a Tukey lambda law with its shape, or a Gaussian one"));
        }
    }
    if let Some(rows) = by.line(json, ["R_scale", "sigR"]) {
        let effect = "effect.row-temporal-noise";
        found.add(&format!("{effect}.sigma_e"), rows.at(low) / low, from);
        found.add(&format!("{effect}.gain_exponent"), rows.slope - 1.0, from);
        lines.push(rows);
    }
    let scatter = lines.iter().map(|l| l.scatter).fold(0.0, f64::max);
    if scatter > 0.0 {
        found.notes.push(format!(
            "noise scatters about its lines over the gain by up to {:.0} %: a camera file has none \
             of that",
            100.0 * scatter
        ));
    }
    Ok(found)
}

/// The shape of the middle of the gains: ELD has one for each, a camera file one.
fn of_many(all: &[f64], found: &mut Imported) -> Option<f64> {
    let middle = *all.get(all.len() / 2)?;
    let (least, most) =
        all.iter().fold((middle, middle), |(a, b), v| (f64::min(a, *v), f64::max(b, *v)));
    if least < most {
        found.notes.push(format!(
            "lambda runs from {least:.3} to {most:.3} over the gains: that of the middle one, \
             {middle:.3}, is written for all, with the standard deviation that it gives"
        ));
    }
    Some(middle)
}

/// Standard deviation of Tukey's lambda law of scale 1: √(2/λ² (1/(1 + 2λ) − B(1 + λ, 1 + λ))).
///
/// # Errors
/// λ up to −½, of which there is none.
pub fn tukey_sd(lambda: f64) -> Result<f64> {
    if lambda <= -0.5 {
        return Err(
            Error::input(format!("lambda {lambda}")).help("noise has a variance above -0.5")
        );
    }
    // Near 0 it is the logistic law.
    if lambda.abs() < 1e-4 {
        return Ok(std::f64::consts::PI / 3f64.sqrt());
    }
    let gamma = libm::tgamma(1.0 + lambda);
    let beta = gamma * gamma / libm::tgamma(2.0 + 2.0 * lambda);
    Ok((2.0 / (lambda * lambda) * (1.0 / (1.0 + 2.0 * lambda) - beta)).sqrt())
}

/// Parameters of PMN (JSON): lines of read noise and rows through a camera's values at gains from 1
/// to `most`. The two laws of the read noise are alternatives, each of all of it: with heavy tails
/// beside a Gaussian part, the former have the deviation of both.
///
/// # Errors
/// A camera without noise.
pub fn to_lines(camera: &Camera, most: f64) -> Result<Json> {
    let sensor = &camera.sensor;
    let gains: Vec<f64> =
        (0..PLACES).map(|i| libm::pow(most.max(1.1), i as f64 / (PLACES - 1) as f64)).collect();
    let k: Vec<f64> = gains.iter().map(|g| sensor.at_gain(*g).dn_per_e).collect();
    let line = |sigma_e: &dyn Fn(f64) -> f64| -> Option<Line> {
        let dn: Vec<f64> = gains.iter().zip(&k).map(|(g, k)| sigma_e(*g) * k).collect();
        if dn.iter().any(|v| *v <= 0.0) {
            return None;
        }
        let design =
            Matrix::from_fn(dn.len(), 2, |i, j| if j == 0 { libm::log(k[i]) } else { 1.0 });
        let target = Vector::from_fn(dn.len(), |i, _| libm::log(dn[i]));
        let fit = LeastSquares::of(&design, &target)?;
        let scatter = (fit.chi2 / (dn.len() as f64 - 2.0)).sqrt();
        Some(Line { slope: fit.coefficients[0], offset: fit.coefficients[1], scatter })
    };
    let power = |sigma: f32, exponent: f32| {
        move |g: f64| f64::from(sigma) * libm::pow(g, f64::from(exponent))
    };
    let top = (1u32 << sensor.bits) - 1;
    let mut out = json!({
        "Kmin": libm::log(k[0]), "Kmax": libm::log(k[PLACES - 1]), "wp": top,
        "q": 1.0 / f64::from(top + 1), "bl": sensor.black_level_dn,
    });
    let mut add = |name: &str, line: Option<Line>| {
        let Some(Line { slope, offset, scatter }) = line else { return };
        for (end, value) in [("k", slope), ("b", offset), ("sig", scatter)] {
            out[format!("{name}{end}")] = json!(value);
        }
    };
    let mut tails = None;
    for effect in &camera.effects {
        match effect {
            Effect::HeavyTailedReadNoise(e) => tails = Some(e),
            Effect::RowTemporalNoise(e) => add("sigR", line(&power(e.sigma_e, e.gain_exponent))),
            _ => (),
        }
    }
    let heavy = |g: f64| tails.map_or(0.0, |e| power(e.sigma_e, e.gain_exponent)(g));
    let read_e = |g: f64| (sensor.at_gain(g).read_variance_e2 + heavy(g).powi(2)).sqrt();
    add("sigGs", line(&read_e));
    if let Some(lambda) = tails.map(|e| f64::from(e.lambda)) {
        let sd = tukey_sd(lambda)?;
        add("sigTL", line(&|g| read_e(g) / sd));
        out["lam"] = json!(lambda);
    }
    Ok(out)
}
