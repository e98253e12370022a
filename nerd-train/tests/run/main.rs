//! Runs from their settings to their models, and how far models are from the truth.

#[path = "../common/mod.rs"]
mod common;
mod evaluate;
mod recorded;
mod settings;
mod trainer;
mod verdict;

use common::*;
