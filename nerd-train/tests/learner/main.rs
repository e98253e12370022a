//! Learners: gradients, updates, and that a run which is stopped and continued equals the unbroken run.

#[path = "../common/mod.rs"]
mod common;
mod files;
mod gradients;
mod resume;
mod updates;
#[cfg(feature = "wgpu")]
mod wgpu;

use common::*;
