//! Values of a camera file that may be, or are, the names of other files.

use schemars::JsonSchema;
use serde::Deserialize;

/// A number from 0 to 1, or the name of a CSV file.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
#[non_exhaustive]
pub enum FractionOrFile {
    Number(#[schemars(range(min = 0.0, max = 1.0))] f64),
    File(FileName),
}

/// The name of a file or directory, relative to the camera file.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(transparent)]
#[schemars(inline, extend("format" = "file"))]
pub struct FileName(pub String);
