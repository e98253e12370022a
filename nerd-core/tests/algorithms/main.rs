//! The algorithms of the dynamics against each other, against energies, differences and closed forms.

#[path = "../common/mod.rs"]
mod common;

mod derivatives;
mod energy;
mod following;
mod forward;
mod lifted;
mod textbook;
mod tree;
