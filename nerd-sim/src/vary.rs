//! Robots that differ from environment to environment (domain randomisation): masses, friction, gains, gravity and the like, drawn from
//! the ranges of `[vary]` in a robot's TOML.
//!
//! ```
//! use nerd_sim::prelude::*;
//! use nerd_sim::{range::Range, vary};
//! let mut system = (*System::named("ant")?).clone();
//! system.spec.vary = Some(vary::VarySpec { mass: Some(Range { low: 0.8, high: 1.2 }), ..Default::default() });
//! let batch = vary::batch(&system.into(), "plane", 64, 0)?;
//! assert!(batch.of(0).robot.mass() != batch.of(1).robot.mass());
//! let simulation = Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&*System::named("ant")?)));
//! # drop(simulation);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::sync::Arc;

use rand::Rng;

use crate::batch::Batch;
use crate::random::stream;
use crate::range::Range;
pub use crate::system::vary::VarySpec;
use crate::system::{System, SystemError};

/// A robot with numbers of its own.
#[derive(Clone, Debug)]
pub struct Varied {
    /// The robot.
    pub system: Arc<System>,
    /// What was drawn, by [`columns`].
    pub drawn: Vec<f64>,
}

/// A system with numbers drawn from the ranges of its `[vary]`; itself, where it has none.
pub fn draw(system: &Arc<System>, rng: &mut impl Rng) -> Varied {
    let Some(vary) = &system.spec.vary else { return Varied { system: system.clone(), drawn: Vec::new() } };
    let (mut own, mut drawn) = ((**system).clone(), Vec::new());
    let mut draw = |range: &Range| {
        let value = range.draw(rng);
        drawn.push(value);
        value
    };
    for link in &mut own.robot.links {
        let body = &mut link.inertia;
        if let Some(factor) = vary.mass.as_ref().map(&mut draw) {
            body.mass *= factor;
            body.inertia *= factor;
        }
        if let Some(factor) = vary.inertia.as_ref().map(&mut draw) {
            body.inertia *= factor;
        }
        if let Some(range) = &vary.com {
            body.com.iter_mut().for_each(|x| *x += draw(range));
        }
    }
    let friction = vary.friction.as_ref().map(&mut draw);
    let stiffness = vary.stiffness.as_ref().map(&mut draw);
    let scenes = own.spec.scenes.iter_mut().filter_map(|s| s.material.as_mut());
    for material in scenes.chain([&mut own.spec.material]) {
        material.friction = friction.unwrap_or(material.friction);
        material.stiffness *= stiffness.unwrap_or(1.0);
        material.damping *= stiffness.unwrap_or(1.0);
    }
    if let Some(size) = vary.gravity.as_ref().map(&mut draw) {
        own.spec.gravity = (own.gravity().normalize() * size).into();
    }
    for (joint, said) in own.robot.joints_mut().zip(&mut own.spec.joints) {
        if let Some(factor) = vary.gain.as_ref().map(&mut draw) {
            said.kp *= factor;
            said.kd *= factor;
        }
        if let Some(factor) = vary.joint_damping.as_ref().map(&mut draw) {
            joint.damping *= factor;
            joint.friction *= factor;
        }
        if let Some(more) = vary.armature.as_ref().map(&mut draw) {
            joint.armature += more;
        }
    }
    Varied { system: Arc::new(own), drawn }
}

/// Names of what [`draw`] draws, in order: `mass:LINK`, `friction`, `gain:JOINT`.
pub fn columns(system: &System) -> Vec<String> {
    let Some(vary) = &system.spec.vary else { return Vec::new() };
    let mut names = Vec::new();
    for link in &system.robot.links {
        names.extend(vary.mass.map(|_| format!("mass:{}", link.name)));
        names.extend(vary.inertia.map(|_| format!("inertia:{}", link.name)));
        names.extend(vary.com.iter().flat_map(|_| ["x", "y", "z"]).map(|axis| format!("com.{axis}:{}", link.name)));
    }
    names.extend(vary.friction.map(|_| "friction".into()));
    names.extend(vary.stiffness.map(|_| "stiffness".into()));
    names.extend(vary.gravity.map(|_| "gravity".into()));
    for joint in system.robot.joints() {
        names.extend(vary.gain.map(|_| format!("gain:{}", joint.name)));
        names.extend(vary.joint_damping.map(|_| format!("joint_damping:{}", joint.name)));
        names.extend(vary.armature.map(|_| format!("armature:{}", joint.name)));
    }
    names
}

/// `n` environments in the scene of this name, each with numbers of its own; as many robots as one where there is no `[vary]`.
///
/// # Errors
/// If there is no such scene.
pub fn batch(system: &Arc<System>, scene: &str, n: usize, seed: u64) -> Result<Batch, SystemError> {
    let mut batch = Batch::new(system, &system.scene(scene)?, n);
    if system.spec.vary.is_some() {
        batch.systems = (0..n as u64).map(|env| draw(system, &mut stream(seed, env)).system).collect();
        batch.scenes = batch.systems.iter().map(|own| own.scene(scene)).collect::<Result<_, _>>()?;
    }
    Ok(batch)
}
