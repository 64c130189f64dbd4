//! How far the bands of a simulation reach: over all wavelengths at which light, lens and sensor
//! meet.
//!
//! What a camera makes of light per nm, in electrons up to a factor, is Φ(λ) T(λ) QE(λ) S(λ) λ:
//! illuminant, lens, quantum efficiency with colour filter, infrared cut. Where it is next to
//! nothing in all channels, bands end. A scene whose data end before it lacks a share of the
//! signal, which is told.

use camrig_base::{Bands, Spectrum, integral_of_product};
use camrig_camera::{Camera, SensorModel};
use camrig_exposure::CubeHeader;
use camrig_light::Illuminant;
use camrig_scene::Beyond;
use camrig_sensor_core::config::MAX_BANDS;

/// Wavelengths at which sensors of silicon see, nm; a table of a camera says less.
pub(crate) const SILICON: Bands = Bands { start_nm: 300.0, step_nm: 10.0, count: 81 };
/// Share of each channel's signal that bands at one end may have to be left out: 1e-3 at both. A
/// trade: infrared cut filters leak some 5e-4 of the light as far as silicon sees, and 1e-4 would
/// take half as many bands again for it.
const UNSEEN: f64 = 5e-4;
/// Share of a channel's signal outside a scene's data above which it is told.
const TOLD: f64 = 1e-3;
/// The same above which it is a warning.
const WARNED: f64 = 1e-2;

/// What a camera sees of some light over wavelength.
pub(crate) struct Sight {
    /// The factors of each channel's signal per nm.
    channels: Vec<Vec<Spectrum>>,
    /// Where the camera's tables let it see at all.
    usable: Bands,
}

impl Sight {
    /// Of the light of an illuminant, or of a spectrum that is even over wavelength.
    pub fn new(camera: &Camera, illuminant: Option<&Illuminant>) -> Self {
        let power = illuminant.map(|illuminant| &illuminant.power);
        let light: Vec<Spectrum> =
            power.into_iter().chain([&camera.lens.transmittance]).cloned().collect();
        Self::of_light(&camera.sensor, &light)
    }

    /// Of light on the sensor whose spectrum is the product of curves.
    fn of_light(sensor: &SensorModel, light: &[Spectrum]) -> Self {
        // A filter that moves over the field is seen where it lies at both ends.
        let most = sensor.filter_angles.as_ref().zip(sensor.ir_cut.as_ref());
        let most = most.map(|(angles, filter)| angles.moved(filter, angles.most_sin2(sensor)));
        let filters: Vec<Vec<Spectrum>> = match (&sensor.ir_cut, most) {
            (Some(filter), Some(most)) => vec![vec![filter.clone()], vec![most]],
            (filter, _) => vec![filter.iter().cloned().collect()],
        };
        let behind = |qe: &Spectrum| -> Vec<Vec<Spectrum>> {
            let each = |filter: &Vec<Spectrum>| {
                let (qe, wavelength) = ([qe.clone()], [Spectrum::wavelength()]);
                [&qe[..], light, filter, &wavelength].concat()
            };
            filters.iter().map(each).collect()
        };
        // A number for the quantum efficiency says nothing of wavelengths: without a table of the
        // sensor or its filter it is that of visible light.
        let is_table = |curve: &Spectrum| curve.samples().nth(1).is_some();
        let any_table = sensor.qe.iter().chain(&sensor.ir_cut).any(is_table);
        Self {
            channels: sensor.qe.iter().flat_map(behind).collect(),
            usable: if any_table { SILICON } else { Bands::VISIBLE },
        }
    }

    /// The signal of a channel between two wavelengths.
    fn signal(channel: &[Spectrum], [from_nm, to_nm]: [f64; 2]) -> f64 {
        let factors: Vec<&Spectrum> = channel.iter().collect();
        if from_nm < to_nm { integral_of_product(&factors, from_nm, to_nm) } else { 0.0 }
    }

    /// From where to where the camera sees, nm; as far as its tables let it where it sees nothing.
    pub fn reach_nm(&self) -> [f64; 2] {
        let bands = self.seen(&self.usable);
        [bands.edges_nm(0)[0], bands.edges_nm(bands.count - 1)[1]]
    }

    /// Those of the bands that count.
    pub fn seen(&self, bands: &Bands) -> Bands {
        let in_bands = |channel: &Vec<Spectrum>| -> Vec<f64> {
            (0..bands.count).map(|band| Self::signal(channel, bands.edges_nm(band))).collect()
        };
        let signal: Vec<Vec<f64>> = self.channels.iter().map(in_bands).collect();
        let (first, count) = seen(&signal);
        Bands { start_nm: bands.nm(first), count, ..*bands }
    }

    /// Bands of 10 nm, or as few as a sensor takes, for a scene that is known from one wavelength
    /// to another, nm.
    pub fn bands(&self, [from_nm, to_nm]: [f64; 2]) -> Option<Bands> {
        let (reach, step) = (self.reach_nm(), SILICON.step_nm);
        let first = (from_nm.max(reach[0]) / step + 0.5).ceil();
        let last = (to_nm.min(reach[1]) / step - 0.5).floor();
        let count = (last >= first).then(|| (last - first) as usize + 1)?;
        let width = (count as f64 / MAX_BANDS as f64).max(1.0);
        Some(Bands {
            start_nm: step * (first + (width - 1.0) / 2.0),
            step_nm: step * width,
            count: count.min(MAX_BANDS),
        })
    }

    /// The largest share of a channel's signal outside two wavelengths, nm; none that is too small
    /// to be told.
    fn outside(&self, data_nm: [f64; 2]) -> Option<f64> {
        let usable = [0, self.usable.count - 1].map(|band| self.usable.edges_nm(band));
        let all = [usable[0][0], usable[1][1]];
        let inside = [data_nm[0].max(all[0]), data_nm[1].min(all[1])];
        let share = |channel: &Vec<Spectrum>| {
            let whole = Self::signal(channel, all);
            if whole > 0.0 { 1.0 - Self::signal(channel, inside) / whole } else { 0.0 }
        };
        Some(self.channels.iter().map(share).fold(0.0, f64::max)).filter(|share| *share > TOLD)
    }

    /// What to tell of a scene whose data reach from one wavelength to another, nm: the share of
    /// the signal outside.
    pub fn note(&self, data_nm: [f64; 2], beyond: Beyond) -> Option<String> {
        let share = self.outside(data_nm)?;
        let kind = if share > WARNED && beyond == Beyond::Dark { "warning: " } else { "" };
        let taken = match beyond {
            Beyond::Dark => {
                "which is missing: the scene is dark there (beyond=hold keeps a \
                             reflectance's end values)"
            }
            Beyond::Hold => "where the scene keeps its end values",
        };
        let [from, to] = data_nm;
        Some(format!(
            "{kind}the scene's data reach from {from} to {to} nm: {:.1} % of the signal of a grey \
             in this light lies outside, {taken}",
            100.0 * share
        ))
    }
}

/// What irradiance lacks for `camera`: the share of the signal outside its bands. A camera that
/// sees farther than the one for which it was made gets no light there.
#[must_use]
pub fn missing(camera: &Camera, header: &CubeHeader) -> Option<String> {
    if header.holds_electrons() {
        return None;
    }
    let bands = header.spectral_bands();
    let [from, to] = [bands.edges_nm(0)[0], bands.edges_nm(bands.count - 1)[1]];
    let share = Sight::of_light(&camera.sensor, &header.light).outside([from, to])?;
    let kind = if share > WARNED { "warning: " } else { "" };
    Some(format!(
        "{kind}the irradiance reaches from {from} to {to} nm: {:.1} % of the signal of a grey in \
         its light lies outside, which is missing",
        100.0 * share
    ))
}

/// What spectra of a chart that end at two wavelengths, nm, do not know of what `camera` sees of
/// it: the share of the signal of a grey that is light beyond them.
#[must_use]
pub fn light_beyond_a_chart(
    camera: &Camera,
    light: &Illuminant,
    data_nm: [f64; 2],
) -> Option<String> {
    let share = Sight::new(camera, Some(light)).outside(data_nm)?;
    let kind = if share > WARNED { "warning: " } else { "" };
    let ([from, to], name) = (data_nm, &light.name);
    Some(format!(
        "{kind}the chart's spectra are known from {from} to {to} nm: {:.1} % of the signal of a \
         grey under {name} is light beyond, which is taken for light within; cut it off with a \
         filter",
        100.0 * share
    ))
}

/// The first band that counts, and how many do.
fn seen(signal: &[Vec<f64>]) -> (usize, usize) {
    let count = signal.first().map_or(0, Vec::len);
    let unseen = |channel: &Vec<f64>, bands: &mut dyn Iterator<Item = usize>| {
        let most = UNSEEN * channel.iter().sum::<f64>();
        let mut sum = 0.0;
        bands
            .take_while(|&band| {
                sum += channel[band];
                sum <= most
            })
            .count()
    };
    let least = |ends: Vec<usize>| ends.into_iter().min().unwrap_or(0);
    let first = least(signal.iter().map(|c| unseen(c, &mut (0..count))).collect());
    let last = least(signal.iter().map(|c| unseen(c, &mut (0..count).rev())).collect());
    // A camera that sees nothing gets all bands.
    if first + last >= count { (0, count) } else { (first, count - first - last) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The signal of a lamp of 850 nm, beside one of 550 nm of the same power, of every built-in
    /// camera: those with a filter see next to none of it, those without what their table says.
    #[test]
    fn cameras_without_an_infrared_cut_see_a_lamp_of_850_nm() {
        let line = |nm: f64| {
            let nm = vec![nm - 10.0, nm, nm + 10.0];
            Spectrum::new(nm, vec![0.0, 1.0, 0.0]).unwrap().outside(camrig_base::Outside::Zero)
        };
        for name in camrig_camera::presets::names() {
            let camera = Camera::load(name).unwrap();
            let signal = |nm: f64| {
                let light = [line(nm), camera.lens.transmittance.clone()];
                let sight = Sight::of_light(&camera.sensor, &light);
                let ends = [nm - 10.0, nm + 10.0];
                let each = sight.channels.iter().map(|channel| Sight::signal(channel, ends));
                (each.fold(0.0, f64::max), sight.reach_nm()[1])
            };
            let ((visible, _), (infrared, reach)) = (signal(550.0), signal(850.0));
            let qe = camera.sensor.qe.iter().map(|qe| qe.at(850.0)).fold(0.0, f64::max);
            let table = camera.sensor.qe.iter().any(|qe| qe.samples().nth(1).is_some());
            match &camera.sensor.ir_cut {
                Some(_) => assert!(infrared < 1e-2 * visible, "{name}: {infrared} {visible}"),
                None => {
                    assert!(table && qe > 0.0, "{name}: no table beyond visible light");
                    assert!(infrared > 0.0 && reach > 850.0, "{name}: {infrared}, {reach} nm");
                }
            }
        }
    }

    /// The part beyond 700 nm of even light and an even sensor of 400 to 1000 nm, 60.7 %, is told
    /// of a chart too.
    #[test]
    fn light_beyond_the_spectra_of_a_chart_is_told() {
        let mut camera = Camera::load("mt9v024").unwrap();
        let light = Illuminant::parse("E").unwrap();
        let visible = camera.clone();
        let flat = Spectrum::new(vec![400.0, 1000.0], vec![0.5, 0.5]).unwrap();
        camera.sensor.qe = vec![flat.outside(camrig_base::Outside::Zero)];
        camera.sensor.ir_cut = None;
        let said = light_beyond_a_chart(&camera, &light, [395.0, 700.0]).unwrap();
        assert!(said.contains("60.7 % of the signal"), "{said}");
        assert_eq!(light_beyond_a_chart(&visible, &light, [300.0, 1000.0]), None);
    }

    #[test]
    fn ends_without_signal_are_left_out() {
        let signal = [vec![0.0, 1e-6, 1.0, 1.0, 0.0, 0.0], vec![0.0, 1.0, 1.0, 1.0, 1e-6, 0.0]];
        assert_eq!(seen(&signal), (1, 3));
        assert_eq!(seen(&[vec![0.0; 3]]), (0, 3));
    }

    /// A sensor without filter and with a quantum efficiency that is even from 400 to 1000 nm, in
    /// light of equal power: the signal of 400 to λ is (λ² - 400²) / (1000² - 400²).
    #[test]
    fn bands_reach_as_far_as_the_camera_sees_and_what_is_missing_is_told() {
        let mut camera = Camera::load("mt9v024").unwrap();
        let flat = Spectrum::new(vec![400.0, 1000.0], vec![0.5, 0.5]).unwrap();
        camera.sensor.qe = vec![flat.outside(camrig_base::Outside::Zero)];
        camera.sensor.ir_cut = None;
        let sight = Sight::new(&camera, Some(&Illuminant::parse("E").unwrap()));
        assert_eq!(sight.reach_nm(), [395.0, 1005.0]);
        let bands = sight.bands([0.0, f64::INFINITY]).unwrap();
        assert_eq!((bands.start_nm, bands.step_nm, bands.count), (400.0, 10.0, 61));
        assert_eq!(sight.bands([380.0, 707.0]).unwrap(), Bands { count: 31, ..bands });
        assert_eq!(sight.bands([1100.0, 1200.0]), None);
        let said = sight.note([395.0, 700.0], Beyond::Dark).unwrap();
        // (1000² - 700²) / (1000² - 400²) = 0.607
        assert!(said.starts_with("warning: ") && said.contains("60.7 % of the signal"), "{said}");
        assert_eq!(sight.note([300.0, 1000.0], Beyond::Dark), None);
        // A table that reaches no further than what was measured needs no note; a number for the
        // quantum efficiency is that of visible light.
        camera.sensor.qe = vec![Spectrum::constant(0.5)];
        assert_eq!(Sight::new(&camera, None).bands([0.0, 2000.0]).unwrap(), Bands::VISIBLE);
    }
}
