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

use crate::internal::*;
pub use crate::system::vary::VarySpec;

/// A system with numbers drawn from the ranges of its `[vary]`, itself where it has none; and what was drawn, by [`columns`].
pub fn draw(system: &Arc<System>, rng: &mut impl Rng) -> (Arc<System>, Vec<f64>) {
    let mut drawn = Vec::new();
    let varied = varied(system, &mut |_, _, range| {
        drawn.push(range.draw(rng));
        drawn[drawn.len() - 1]
    });
    (varied.map_or_else(|| system.clone(), Arc::new), drawn)
}

/// Names of what [`draw`] draws, in order: `mass:LINK`, `friction`, `gain:JOINT`.
pub fn columns(system: &System) -> Vec<String> {
    let mut names = Vec::new();
    varied(system, &mut |what, whose, range| {
        names.push(if whose.is_empty() { what.into() } else { format!("{what}:{whose}") });
        range.low
    });
    names
}

/// A system with the numbers that `take` gives for each range of its `[vary]`, if it has one: what it is of, whose, and the range.
fn varied(system: &System, take: &mut dyn FnMut(&str, &str, &Range) -> f64) -> Option<System> {
    let vary = system.spec.vary.as_ref()?;
    let mut own = system.clone();
    let mut take = |what: &str, whose: &str, range: &Option<Range>| range.as_ref().map(|range| take(what, whose, range));
    for link in &mut own.robot.links {
        let body = &mut link.inertia;
        if let Some(factor) = take("mass", &link.name, &vary.mass) {
            body.mass *= factor;
            body.inertia *= factor;
        }
        if let Some(factor) = take("inertia", &link.name, &vary.inertia) {
            body.inertia *= factor;
        }
        for (x, what) in body.com.iter_mut().zip(["com.x", "com.y", "com.z"]) {
            if let Some(shift) = take(what, &link.name, &vary.com) {
                *x += shift;
            }
        }
    }
    let friction = take("friction", "", &vary.friction);
    let stiffness = take("stiffness", "", &vary.stiffness).unwrap_or(1.0);
    let scenes = own.spec.scenes.iter_mut().filter_map(|s| s.material.as_mut());
    for material in scenes.chain([&mut own.spec.material]) {
        material.friction = friction.unwrap_or(material.friction);
        material.stiffness *= stiffness;
        material.damping *= stiffness;
    }
    if let Some(size) = take("gravity", "", &vary.gravity) {
        own.spec.gravity = (own.gravity().normalize() * size).into();
    }
    for (joint, spec) in own.robot.joints_mut().zip(&mut own.spec.joints) {
        if let Some(factor) = take("gain", &joint.name, &vary.gain) {
            spec.kp *= factor;
            spec.kd *= factor;
        }
        if let Some(factor) = take("joint_damping", &joint.name, &vary.joint_damping) {
            joint.damping *= factor;
            joint.friction *= factor;
        }
        if let Some(more) = take("armature", &joint.name, &vary.armature) {
            joint.armature += more;
        }
    }
    Some(own)
}

/// `n` environments in the scene of this name, each with numbers of its own; as many robots as one where there is no `[vary]`.
pub fn batch(system: &Arc<System>, scene: &str, n: usize, seed: u64) -> Result<Batch, SystemError> {
    let mut batch = Batch::new(system, &system.scene(scene)?, n);
    if system.spec.vary.is_some() {
        batch.systems = (0..n as u64).map(|env| draw(system, &mut stream(seed, env)).0).collect();
        batch.scenes = batch.systems.iter().map(|own| own.scene(scene)).collect::<Result<_, _>>()?;
    }
    Ok(batch)
}
