//! Imports that most files of this crate use.
// Some are needed only with certain features.
#![allow(unused_imports)]

pub(crate) use std::collections::BTreeMap;
pub(crate) use std::path::{Path, PathBuf};

pub(crate) use nerd_core::dynamics::{Factor, bias, crba, inertias, to_local, to_world, velocities};
pub(crate) use nerd_core::robot::ShapeKind;
pub(crate) use rand::{Rng, RngExt};
pub(crate) use serde::{Deserialize, Serialize};

pub(crate) use crate::files::FileError;
pub(crate) use crate::prelude::*;
pub(crate) use crate::range::{law, within};
pub(crate) use crate::system::Spec;
