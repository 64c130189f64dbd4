//! Region of interest and binning, arguments of several commands.

use super::live;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_formats::mcap::CameraInfo;
use camrig_render::readout::{self, Readout, Region};

/// How pixels are combined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Binning {
    /// Pixels in a row and in a column.
    pub n: u32,
    /// Charges are summed before readout, instead of averaging samples.
    pub charge: bool,
}

/// Reads `2`, `2x2`, `2x2:digital` or `2x2:charge`.
pub fn binning(text: &str) -> Result<Binning, String> {
    let wrong = || format!("{text:?} is not a binning; use 2x2, 2x2:digital or 2x2:charge");
    let (size, kind) = text.split_once(':').unwrap_or((text, "digital"));
    let (across, down) = size.split_once('x').unwrap_or((size, size));
    let charge = match kind {
        "charge" => true,
        "digital" => false,
        _ => return Err(wrong()),
    };
    match across.parse() {
        Ok(n) if across == down && n > 0 => Ok(Binning { n, charge }),
        _ => Err(wrong()),
    }
}

fn region(text: &str) -> Result<Region, String> {
    let camrig_measure::mtf::Roi { x, y, width, height } = super::measure::roi(text)?;
    Ok(Region { x, y, width, height })
}

/// Region and binning.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct ReadoutArgs {
    /// Read only this region of the frame, in pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = region)]
    roi: Option<Region>,
    /// Combine N x N pixels of a colour, after cropping: 2x2 or 2x2:digital (mean of samples),
    /// 2x2:charge (charges summed before readout; monochrome sensors, scenes and plans only)
    #[arg(long, value_name = "NxN[:KIND]", value_parser = binning)]
    binning: Option<Binning>,
}

impl ReadoutArgs {
    /// The digital readout of each frame.
    pub fn readout(&self) -> Readout {
        let digital = self.binning.filter(|binning| !binning.charge);
        Readout { region: self.roi, binning: digital.map(|binning| binning.n) }
    }

    /// Whether pixels are combined.
    pub fn bins(&self) -> bool {
        self.binning.is_some()
    }

    /// Whether charges are summed.
    pub fn adds_charge(&self) -> bool {
        self.binning.is_some_and(|binning| binning.charge)
    }

    /// The camera with summed charges, if charge binning is asked for.
    ///
    /// # Errors
    /// A region together with charge binning, and those of [`readout::charge_binned`].
    pub fn camera(&self, camera: Camera) -> Result<Camera> {
        match self.binning {
            Some(Binning { charge: true, .. }) if self.roi.is_some() => {
                Err(Error::unsupported("charge binning of a region")
                    .help("bin digitally, or omit the region: its pixels are single ones"))
            }
            Some(Binning { n, charge: true }) => readout::charge_binned(&camera, n),
            _ => Ok(camera),
        }
    }

    /// Refuses charge binning of stored irradiance, which is of single pixels.
    pub fn refuse_charge(&self) -> Result<()> {
        match self.adds_charge() {
            true => Err(Error::unsupported("charge binning of stored irradiance")
                .help("use camrig simulate --binning 2x2:charge, or bin digitally")),
            false => Ok(()),
        }
    }

    /// `CameraInfo` of the camera with this readout.
    pub fn figures(&self, camera: &Camera) -> Result<CameraInfo> {
        let readout = self.readout();
        Ok(live::figures(camera)?.of_part(readout.begin(), readout.side()))
    }

    /// Region and binning, for a report.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let mut rows = Vec::new();
        if let Some(r) = self.roi {
            let place = format!("{} x {} pixels from {}, {}", r.width, r.height, r.x, r.y);
            rows.push(("region of interest", place));
        }
        if let Some(Binning { n, charge }) = self.binning {
            let kind = if charge { "charges summed" } else { "mean of samples" };
            rows.push(("binning", format!("{n} x {n} pixels, {kind}")));
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binnings_and_regions() {
        for (text, n, charge) in
            [("2", 2, false), ("2x2", 2, false), ("4x4:charge", 4, true), ("3:digital", 3, false)]
        {
            assert_eq!(binning(text), Ok(Binning { n, charge }), "{text}");
        }
        for text in ["0", "2x3", "2x2:sum", "x", ""] {
            assert!(binning(text).is_err(), "{text}");
        }
        let region = region("40,20,80,60").unwrap();
        assert_eq!((region.x, region.y, region.width, region.height), (40, 20, 80, 60));
    }
}
