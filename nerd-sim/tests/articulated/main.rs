//! The articulated solver, its contact and its scenes, against closed forms and textbook values.

mod cart;
#[path = "../common/mod.rs"]
mod common;
mod convergence;
mod drives;
mod falling;
mod filed;
mod folding;
#[cfg(feature = "rapier")]
mod forces;
mod friction;
mod joints;
mod limits;
mod standing;
mod terrain;
mod touching;
mod turning;
mod worlds;
