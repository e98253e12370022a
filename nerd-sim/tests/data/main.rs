//! Data sets, tables, measured trajectories and calibration: writing, reading and refusals.

#[cfg(feature = "csv")]
mod arrays;
#[cfg(all(feature = "calibrate", feature = "rapier"))]
mod calibrate;
#[path = "../common/mod.rs"]
mod common;
mod dataset;
mod files;
#[cfg(feature = "csv")]
mod log;
mod motions;
#[cfg(all(feature = "calibrate", feature = "rapier"))]
mod real;
#[cfg(feature = "csv")]
mod rollout;
#[cfg(feature = "csv")]
mod tossed;
