//! Section VI of Chen et al. 2009 as one comparison: frames of a model and of an improved model
//! with captured frames.

use crate::paper::{
    CAPTURED, Captured, Differences, Figures, LEVELS, Level, Places, Taken, captured_camera,
    comparable, of_captures, take, with_causes,
};
use camrig_base::{Error, Result};
use camrig_camera::Camera;

/// The inputs of a comparison.
#[derive(Default)]
pub struct Sides {
    /// Captured frames; by default those of the model with the causes that the paper states, as
    /// another physical sensor ([`captured_camera`]).
    pub captured: Option<Captured>,
    /// An improved model; without captured frames, by default the model with the paper's causes
    /// ([`with_causes`]).
    pub improved: Option<Camera>,
    /// Positions of chart and edge in the captured frames.
    pub places: Places,
}

/// Frames and figures of one side.
pub struct Measured {
    /// The frames.
    pub taken: Taken,
    /// Their figures.
    pub figures: Figures,
}

impl Measured {
    fn of(taken: Taken, places: &Places) -> Result<Self> {
        Ok(Self { figures: Figures::of(&taken, places)?, taken })
    }
}

/// The comparison.
pub struct Comparison {
    /// The light levels of the frames, bright and dim.
    pub levels: [Level; 2],
    /// The captured side.
    pub captured: Measured,
    /// The model.
    pub model: Measured,
    /// The improved model, if there is one.
    pub improved: Option<Measured>,
    /// Captured minus model.
    pub before: Differences,
    /// Captured minus improved model.
    pub after: Option<Differences>,
    /// The camera file with the causes of the differences, as text.
    pub causes: String,
    is_substitute: bool,
}

impl Comparison {
    /// Simulates and measures the frames of `model` and of the other sides. `progress` is called
    /// with the number of cameras done and of all cameras.
    ///
    /// # Errors
    /// A capture set without the captures of the paper, frames of another size or colour filter
    /// pattern, a chart or an edge at another position, and those of rendering.
    pub fn of(
        model: &Camera,
        sides: Sides,
        mut progress: impl FnMut(usize, usize),
    ) -> Result<Self> {
        let Sides { captured, improved, places } = sides;
        let is_substitute = captured.is_none() && improved.is_none();
        let improved = match improved {
            None if is_substitute => Some(with_causes(model)?),
            given => given,
        };
        let captured = match captured {
            Some(captured) => captured,
            None => Captured::Camera(Box::new(captured_camera(model)?)),
        };
        let mut cameras = vec![model];
        cameras.extend(&improved);
        let from_set = match &captured {
            Captured::Set(set) => Some(of_captures(set)?),
            Captured::Camera(camera) => {
                cameras.push(camera);
                None
            }
        };
        let levels = from_set.as_ref().map_or(LEVELS, |(_, levels)| *levels);
        let (mut done, all) = (0, cameras.len());
        progress(done, all);
        let taken = take(&cameras, &levels, || {
            done += 1;
            progress(done, all);
        })?;
        // One for each camera, in order.
        let mut taken = taken.into_iter();
        let nothing = || Error::internal("a camera took no frames");
        let modelled = taken.next().ok_or_else(nothing)?;
        let better = improved.as_ref().and_then(|_| taken.next());
        let captured = match from_set {
            Some((taken, _)) => taken,
            None => taken.next().ok_or_else(nothing)?,
        };
        for simulated in [Some(&modelled), better.as_ref()].into_iter().flatten() {
            comparable(&simulated.chart, &captured.chart)?;
        }
        let captured = Measured::of(captured, &places).map_err(|e| e.at("captured"))?;
        // The given positions are those of the captured frames; simulated ones have the built-in
        // ones.
        let model_side = Measured::of(modelled, &Places::default()).map_err(|e| e.at("model"))?;
        let better = better.map(|t| Measured::of(t, &Places::default())).transpose()?;
        let before = captured.figures.against(&model_side.figures)?;
        let after = better.as_ref().map(|b| captured.figures.against(&b.figures)).transpose()?;
        let causes = match (is_substitute, improved) {
            (true, _) => CAPTURED.to_owned(),
            (false, improved) => improved.map_or_else(|| model.text.clone(), |c| c.text),
        };
        Ok(Self {
            levels,
            captured,
            model: model_side,
            improved: better,
            before,
            after,
            causes,
            is_substitute,
        })
    }

    /// Notes on the scenes, their light, and the lenses and tables of the sides.
    pub fn notes(&self) -> impl Iterator<Item = &String> {
        let sides = [Some(&self.model), self.improved.as_ref(), Some(&self.captured)];
        sides.into_iter().flatten().flat_map(|side| &side.taken.notes)
    }

    /// Whether the comparison succeeds: with the substitute for the paper's module, if the
    /// differences have the sizes that the paper reports and vanish with their causes; with
    /// captured frames or an improved model, if no difference remains.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.failures().is_empty()
    }

    /// What keeps it from that: the figures, with what was found and what is allowed, in words.
    #[must_use]
    pub fn failures(&self) -> Vec<String> {
        match &self.after {
            Some(after) if self.is_substitute => {
                [self.before.not_as_reported(), after.remaining_of_substitute()].concat()
            }
            Some(after) => after.remaining(),
            None => self.before.remaining(),
        }
    }
}
