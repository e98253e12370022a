//! Disturbances of an episode: pushes and sensor noise, as `[vary]` defines them. Each frame draws from fixed positions
//! of the episode's random stream, so number and order of calls have no influence.
//!
//! ```
//! use nerd_sim::prelude::*;
//! use nerd_sim::{disturb::pushed, vary::VarySpec};
//! let mut system = (*System::named("ant")?).clone();
//! system.spec.vary = Some(VarySpec { push: Some(Range { low: 0.5, high: 0.5 }), push_every: Some(2.0), ..Default::default() });
//! let mut state = start(&system, Start::Reset, &mut stream(0, 0));
//! let every = (2.0 / system.frame_time).round() as u64;
//! assert!(!pushed(&system, &mut state.clone(), 1, stream(0, 0)) && pushed(&system, &mut state, every, stream(0, 0)));
//! # Ok::<(), SystemError>(())
//! ```

use std::f64::consts::TAU;

use nerd_core::state::wrap_state;
use rand_chacha::ChaCha8Rng;

use crate::{internal::*, sampling::normal, scene::up};

/// First block of an episode's pushes in the episode's random stream; `NOISES`: of its sensor noise. Both lie far
/// behind the start of the stream.
pub(crate) const PUSHES: u64 = 1 << 40;
pub(crate) const NOISES: u64 = 2 << 40;
const WORDS_PER_BLOCK: u128 = 16;
/// Number of 32-bit words that a drawn number takes from the stream.
const WORDS_PER_NUMBER: usize = 2;

/// Frames from one push to the next; `None` without pushes.
pub(crate) fn every(system: &System) -> Option<u64> {
    let period = system.spec.vary.as_ref().filter(|vary| vary.push.is_some())?.push_every?;
    Some(((period / system.frame_time).round() as u64).max(1))
}

/// Two perpendicular unit vectors normal to gravity; x and y without gravity.
pub(crate) fn level(system: &System) -> [Vector3<f64>; 2] {
    let up = up(&system.gravity());
    let across = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let one = (across - up * up.dot(&across)).normalize();
    [one, up.cross(&one)]
}

/// Number of stream blocks that a frame's noise takes. Each component of the root's four vectors takes two draws, and
/// so does each joint's position and velocity.
pub(crate) fn blocks(system: &System) -> u64 {
    ((24 + 4 * system.robot.joint_count()) * WORDS_PER_NUMBER).div_ceil(WORDS_PER_BLOCK as usize) as u64
}

/// In a frame with a push, adds a drawn velocity (m/s) in a random horizontal direction to a free root. Returns whether
/// the frame had a push.
pub fn pushed(system: &System, state: &mut [f64], frame: u64, mut episode: ChaCha8Rng) -> bool {
    let (Some(every), Some(size)) = (every(system), system.spec.vary.as_ref().and_then(|vary| vary.push)) else {
        return false;
    };
    if frame == 0 || !frame.is_multiple_of(every) {
        return false;
    }
    episode.set_word_pos(u128::from(PUSHES + frame / every) * WORDS_PER_BLOCK);
    let size = size.draw(&mut episode);
    let angle = TAU * episode.random::<f64>();
    let [one, other] = level(system);
    let change = one * (size * angle.cos()) + other * (size * angle.sin());
    state[system.robot.nq() + 3..].iter_mut().zip(change.iter()).for_each(|(v, by)| *v += by);
    true
}

/// Replaces a state by the noisy sensor reading of this frame.
pub fn blurred(system: &System, state: &mut [f64], frame: u64, mut episode: ChaCha8Rng) {
    if system.noisy() {
        episode.set_word_pos(u128::from(NOISES + frame * blocks(system)) * WORDS_PER_BLOCK);
        blur(system, state, &mut episode);
    }
}

/// Adds sensor noise to a state.
pub(crate) fn blur(system: &System, state: &mut [f64], rng: &mut impl Rng) {
    let robot = &system.robot;
    let size = system.motors.noise;
    let per = 1.0 / system.frame_time;
    let (q, qd) = state.split_at_mut(robot.nq());
    if robot.floating() && system.motors.root_noise != [0.0; 2] {
        let mut apart = |size: f64| Vector3::from_fn(|_, _| size * normal(rng));
        let [place, turn] = system.motors.root_noise;
        let (at, turned, faster, spinning) = (apart(place), apart(turn), apart(place * per), apart(turn * per));
        to_local(robot, q, qd);
        let pose = quaternion(&q[3..7]) * UnitQuaternion::from_scaled_axis(turned);
        write_quaternion(&mut q[3..7], &pose);
        (0..3).for_each(|k| (q[k], qd[k], qd[3 + k]) = (q[k] + at[k], qd[k] + spinning[k], qd[3 + k] + faster[k]));
        to_world(robot, q, qd);
    }
    q[robot.root_coords()..].iter_mut().for_each(|q| *q += size * normal(rng));
    qd[robot.root_dofs()..].iter_mut().for_each(|v| *v += size * per * normal(rng));
    wrap_state(robot, state);
}
