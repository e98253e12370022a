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
use super::row::Row;
use super::trial::{Error, Motion, Trial};
use nerd_sim::prelude::*;

/// All rows, in the order of tables.
pub(super) fn all() -> impl Iterator<Item = &'static Row> {
    let rolling = rolling::ROWS.iter().chain(&round::ROWS);
    let contact = contact::LANDING
        .iter()
        .chain(&contact::ROWS)
        .chain(rolling)
        .chain(&contact::PASSIVE)
        .chain(&robots::CONSISTENCY);
    flight::ROWS
        .iter()
        .chain(&joints::ROWS)
        .chain(contact)
        .chain(&cables::ROWS)
        .chain(&robots::ROWS)
        .chain(&runner::ROWS)
        .chain(&energy::ROWS)
}
