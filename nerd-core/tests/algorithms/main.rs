//! Dynamics algorithms against each other, energies, finite differences and closed forms.

#[path = "../common/mod.rs"]
mod common;

mod derivatives;
mod energy;
mod following;
mod forward;
mod lifted;
mod textbook;
mod tree;
