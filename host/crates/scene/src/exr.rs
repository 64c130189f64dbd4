//! Spectral OpenEXR images, one channel per band.
//!
//! Layout: A. Fichet, R. Pacanowski, A. Wilkie, "An OpenEXR Layout for Spectral Images", JCGT
//! 10(3), 2021: radiance in channels `S0.550,000000nm`, reflectance in `T.550,000000nm`, with a
//! decimal comma (a point is read as well) and units nm, um or m. Channels are decoded one at a
//! time, so a cube needs the memory of one band.

use super::Quantity;
use super::cube::{BandSource, Cube};
use super::sidecar::Sidecar;
use ::exr::prelude::{MetaData, ReadChannels, ReadLayers, ReadSpecificChannel, read};
use camrig_base::{Error, Plane, Result};
use std::path::{Path, PathBuf};

fn refused(error: ::exr::error::Error) -> Error {
    Error::input(format!("not a readable OpenEXR image: {error}"))
}

/// Opens the spectral channels of an image.
pub(super) fn open(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    let meta = MetaData::read_from_file(path, false).map_err(refused)?;
    let Some(header) = meta.headers.first() else {
        return Err(Error::input("an OpenEXR file without an image"));
    };
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    let bands_of = |prefix: &str| -> Vec<(f64, String)> {
        let of_prefix = names
            .iter()
            .filter_map(|name| Some((wavelength_nm(name.strip_prefix(prefix)?)?, name.clone())));
        let mut bands: Vec<(f64, String)> = of_prefix.collect();
        bands.sort_by(|a, b| a.0.total_cmp(&b.0));
        bands
    };
    let (radiance, reflectance) = (bands_of("S0."), bands_of("T."));
    let (bands, own) = if radiance.is_empty() {
        (reflectance, Quantity::Reflectance)
    } else {
        (radiance, Quantity::Radiance)
    };
    if bands.is_empty() {
        let names = names.join(", ");
        return Err(Error::unsupported(format!("no spectral channel among {names}")).help(
            "name channels like S0.550,000000nm (radiance) or T.550,000000nm (reflectance)",
        ));
    }
    let (nm, channels): (Vec<f64>, Vec<String>) = bands.into_iter().unzip();
    let size = (header.layer_size.width(), header.layer_size.height());
    let scale = sidecar.scale.unwrap_or(1.0);
    let source = Channels { path: path.into(), size, channels, scale };
    Cube::new(Box::new(source), nm, sidecar.quantity(Some(own)))
}

/// The wavelength in a name such as `550,000000nm`, in nm.
fn wavelength_nm(text: &str) -> Option<f64> {
    let split = text.find(|c: char| c.is_ascii_alphabetic())?;
    let (number, unit) = text.split_at(split);
    let to_nm = match unit {
        "nm" => 1.0,
        "um" => 1e3,
        "m" => 1e9,
        _ => return None,
    };
    Some(number.replace(',', ".").parse::<f64>().ok()? * to_nm)
}

struct Channels {
    path: PathBuf,
    size: (usize, usize),
    channels: Vec<String>,
    scale: f32,
}

impl BandSource for Channels {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn bands(&self) -> usize {
        self.channels.len()
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let scale = self.scale;
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .specific_channels()
            .required(self.channels[band].as_str())
            .collect_pixels(
                |size, _| Plane::filled(size.width(), size.height(), 0.0f32),
                move |plane: &mut Plane<f32>, at, (value,): (f32,)| {
                    let width = plane.width;
                    plane.data[at.y() * width + at.x()] = value * scale;
                },
            )
            .first_valid_layer()
            .all_attributes()
            .from_file(&self.path)
            .map_err(refused)?;
        Ok(image.layer_data.channel_data.pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Grid, open as open_scene};
    use ::exr::prelude::*;

    #[test]
    fn spectral_channels_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("scene.exr");
        for (prefix, quantity) in [("S0", Quantity::Radiance), ("T", Quantity::Reflectance)] {
            let channels = (0..31).map(|b| {
                let name = format!("{prefix}.{},000000nm", 400 + 10 * b);
                let samples = (0..6).map(|i| i as f32 / 10.0 + b as f32 / 100.0).collect();
                AnyChannel::new(name.as_str(), FlatSamples::F32(samples))
            });
            let mut channels: Vec<_> = channels.collect();
            channels.push(AnyChannel::new("R", FlatSamples::F32(vec![9.0; 6])));
            let layer = Layer::new(
                (3, 2),
                LayerAttributes::named("scene"),
                Encoding::SMALL_LOSSLESS,
                AnyChannels::sort(channels.into()),
            );
            Image::from_layer(layer).write().to_file(&path).unwrap();
            let scene = open_scene(path.to_str().unwrap()).unwrap();
            assert_eq!(scene.quantity(), quantity);
            let grid = Grid { width: 3, height: 2, left: -0.5, top: -1.0 / 3.0, cell: 1.0 / 3.0 };
            let plane = scene.plane(20, &grid).unwrap();
            for (i, got) in plane.data.iter().enumerate() {
                assert!((got - (i as f32 / 10.0 + 0.2)).abs() < 1e-6);
            }
        }
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..100]).unwrap();
        assert!(open_scene(path.to_str().unwrap()).is_err());
    }
}
