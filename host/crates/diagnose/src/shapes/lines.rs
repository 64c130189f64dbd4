//! The lines of a sensor, which shapes are common to or have profiles over.

use crate::report::Form;
use camrig_camera::empirical::{Curve, Table};

/// Rows or columns.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lines {
    Rows,
    Columns,
}

impl Lines {
    /// The other ones.
    pub fn across(self) -> Self {
        match self {
            Self::Rows => Self::Columns,
            Self::Columns => Self::Rows,
        }
    }

    /// The name of one.
    pub fn word(self) -> &'static str {
        match self {
            Self::Rows => "row",
            Self::Columns => "column",
        }
    }

    /// How many there are in a frame.
    pub fn count(self, width: usize, height: usize) -> usize {
        match self {
            Self::Rows => height,
            Self::Columns => width,
        }
    }

    /// The one that a pixel lies in.
    pub fn at(self, x: usize, y: usize) -> usize {
        match self {
            Self::Rows => y,
            Self::Columns => x,
        }
    }

    /// The one that a pixel lies in, by its index in a frame `width` wide.
    pub fn of(self, pixel: usize, width: usize) -> usize {
        self.at(pixel % width, pixel / width)
    }

    /// The form of a profile with a value for each of them.
    pub fn profile(self) -> Form {
        match self {
            Self::Rows => Form::ColumnProfile,
            Self::Columns => Form::RowProfile,
        }
    }

    /// Such a profile as the table of a stage.
    pub fn table(self, profile: Curve) -> Table {
        match self {
            Self::Rows => Table::ColumnProfile(profile),
            Self::Columns => Table::RowProfile(profile),
        }
    }
}
