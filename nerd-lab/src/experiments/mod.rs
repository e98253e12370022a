//! Measurements for this repository's figures. The experiments of the users' verbs, and what an experiment is, are in
//! [`nerd_cli::experiments`].

pub mod chart;
pub mod family;
pub mod motions;
pub mod stability;
pub mod worth;
