//! What most files of this crate use.

pub(crate) use std::path::{Path, PathBuf};
pub(crate) use std::time::{Duration, Instant};

pub(crate) use nerd_model::base::Base;
pub(crate) use nerd_model::folder::Model;
pub(crate) use nerd_model::form::{Form, View};
pub(crate) use nerd_model::normalizer::Normalizer;
pub(crate) use nerd_model::transformer::{Architecture, ForwardError, Positions, Stream, TransformerConfig, Weights};
pub(crate) use nerd_sim::dataset::GenerateConfig;
pub(crate) use nerd_sim::prelude::*;
pub(crate) use nerd_tasks::Episodes;
pub(crate) use serde::{Deserialize, Serialize};

pub(crate) use crate::error::{Error, Result, refuse};
pub(crate) use crate::learner::{LearnError, Learner, LearnerConfig, LearnerState, Optimizer, Progress};
pub(crate) use crate::ranks::{RankError, Ranks};
pub(crate) use crate::windows::Windows;
