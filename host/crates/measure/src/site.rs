//! Sites: the positions of the colour filter pattern, and the pixels of each.

use camrig_base::Cfa;

/// One position of the colour filter pattern: the pixels at `(x0 + i step_x, y0 + j step_y)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Site {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// Columns from one pixel to the next.
    pub step_x: usize,
    /// Rows from one pixel to the next.
    pub step_y: usize,
    /// Channel number (see [`Cfa`]).
    pub channel: usize,
}

impl Site {
    /// The sites of a pattern, row-major.
    pub fn all(cfa: &Cfa) -> Vec<Site> {
        let mut sites = Vec::with_capacity(cfa.width * cfa.height);
        for y0 in 0..cfa.height {
            for x0 in 0..cfa.width {
                let channel = cfa.channel(x0, y0);
                sites.push(Site { x0, y0, step_x: cfa.width, step_y: cfa.height, channel });
            }
        }
        sites
    }

    /// Columns of the site's plane in a frame `width` wide.
    pub fn columns(&self, width: usize) -> usize {
        (width + self.step_x - 1 - self.x0) / self.step_x
    }

    /// Rows of the site's plane in a frame `height` high.
    pub fn rows(&self, height: usize) -> usize {
        (height + self.step_y - 1 - self.y0) / self.step_y
    }

    /// Column and row of each of the site's pixels in a frame of `width` x `height`.
    pub fn pixels(&self, width: usize, height: usize) -> impl Iterator<Item = (usize, usize)> {
        let Self { x0, y0, step_x, step_y, .. } = *self;
        (y0..height)
            .step_by(step_y)
            .flat_map(move |y| (x0..width).step_by(step_x).map(move |x| (x, y)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sites_cover_odd_frames() {
        let sites = Site::all(&Cfa::parse("GRBG").unwrap());
        let pixels: usize = sites.iter().map(|s| s.rows(5) * s.columns(7)).sum();
        assert_eq!(pixels, 35);
        assert_eq!(sites.iter().map(|s| s.channel).collect::<Vec<_>>(), [1, 0, 2, 1]);
    }
}
