//! `cargo xtask live`: simulates a robot in real time and shows it in a browser on this machine. The visitor pushes the
//! robot and swaps its solver while it moves.
//!
//! One thread owns the [`World`] and steps it, handles requests between frames, and publishes the latest frame as JSON.
//! Server threads answer from that copy, so no client can delay the motion or another client.

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
