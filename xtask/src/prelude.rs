//! Common imports of the verbs.

pub(crate) use std::path::PathBuf;

pub(crate) use anyhow::{Context, Result, bail};
pub(crate) use itertools::Itertools;
pub(crate) use nerd_cli::options::{Keys, Whole, value, word};
pub(crate) use nerd_train::{device::Device, shipped::results};
