//! From recorded motions to tokens and targets, and back in a rollout.

#[path = "../common/mod.rs"]
mod common;
mod family;
mod same_as_trained;
mod supply;
mod tokens;

use common::*;
