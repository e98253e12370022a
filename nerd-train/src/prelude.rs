//! Imports shared by most files of this crate.

pub(crate) use std::collections::BTreeMap;
pub(crate) use std::path::{Path, PathBuf};
pub(crate) use std::sync::{Mutex, PoisonError};
pub(crate) use std::time::{Duration, Instant};

pub(crate) use itertools::{Itertools, izip};
pub(crate) use nerd_model::base::Base;
pub(crate) use nerd_model::features::Features;
pub(crate) use nerd_model::folder::{Model, ModelConfig};
pub(crate) use nerd_model::form::{Form, View};
pub(crate) use nerd_model::neural::Neural;
pub(crate) use nerd_model::normalizer::{Moments, Normalizer};
pub(crate) use nerd_model::program::cpu::{Loaded, Memory, Pass, add};
pub(crate) use nerd_model::transformer::{Architecture, ForwardResult, Positions, Stream, TransformerConfig, Weights};
pub(crate) use nerd_sim::dataset::{DatasetError, GenerateConfig};
pub(crate) use nerd_sim::files::hex;
pub(crate) use nerd_sim::prelude::*;
pub(crate) use nerd_sim::range::within;
pub(crate) use nerd_sim::trajectories::Trajectories;
pub(crate) use nerd_tasks::{ChaCha8Rng, Episodes, Snapshot, Task};
pub(crate) use rand::RngExt;
pub(crate) use rayon::prelude::*;
pub(crate) use serde::{Deserialize, Serialize};
pub(crate) use serde_json::json;
pub(crate) use sha2::{Digest, Sha256};

pub(crate) use crate::difference::between;
pub(crate) use crate::error::{Error, Result, part, refuse};
pub(crate) use crate::learner::{
    LearnError, LearnResult, Learner, LearnerConfig, LearnerState, Optimizer, Progress, validation_rows,
};
pub(crate) use crate::progress::bar;
pub(crate) use crate::stop::Stop;
pub(crate) use crate::tensors::Tensors;
pub(crate) use crate::windows::Windows;
