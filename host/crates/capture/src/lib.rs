//! Taking sets of captures with a simulated camera or a rig: [`plan`] says which stacks, [`take`] takes
//! them, [`bench`] stands for the light sources of a laboratory.

pub mod bench;
pub mod plan;
pub mod take;
