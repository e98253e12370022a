//! From recorded motions to what a network learns from, and back in a rollout.

#[path = "../common/mod.rs"]
mod common;
mod family;
mod same_as_trained;
mod supply;
mod tokens;

use common::*;
