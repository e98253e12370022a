//! `cargo xtask live`: a robot that steps in real time, seen and pushed in a browser on this machine, while solvers are swapped under it.
//!
//! One thread owns the [`World`] and steps it; it takes what visitors ask for between two frames and leaves the latest frame as JSON. The
//! threads of the server answer from that, so that no visitor can hold up the motion or another visitor.

mod act;
mod ask;
mod crowd;
mod hand;
mod http;
mod menu;
mod server;
mod world;

pub use act::Act;
pub use ask::Ask;
pub use menu::{MOST, Menu};
pub use server::Live;
pub use world::{Shown, World};
