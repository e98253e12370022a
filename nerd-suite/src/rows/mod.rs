//! The rows of the suite, grouped by subject.

mod cables;
mod contact;
mod energy;
mod flight;
mod joints;
mod robots;
mod rolling;
mod round;
mod runner;

use super::bodies::{Body, UPRIGHT};
use super::figures::{momentum_change, most, pushes, sunk, velocity, worst};
use super::row::{Row, row};
use super::trial::{Motion, Result, Trial, limp, rise};
use nerd_sim::prelude::*;
use rand::RngExt;

/// All rows, in the order of tables.
pub(super) fn all() -> impl Iterator<Item = &'static Row> {
    [
        flight::ROWS,
        joints::ROWS,
        contact::LANDING,
        contact::ROWS,
        rolling::ROWS,
        round::ROWS,
        contact::PASSIVE,
        robots::CONSISTENCY,
        cables::ROWS,
        robots::ROWS,
        runner::ROWS,
        energy::ROWS,
    ]
    .into_iter()
    .flatten()
}
