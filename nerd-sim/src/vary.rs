//! Domain randomisation: robots that differ between environments in mass, friction, gains, gravity and other
//! parameters. Ranges come from `[vary]` in a robot's TOML.
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
use crate::robots::motors::Motors;
pub use crate::robots::vary::VarySpec;

/// A system with parameters drawn from the ranges of its `[vary]`, and the drawn numbers in the order of [`columns`].
/// Without `[vary]`, returns the same system and no numbers.
pub fn draw(system: &Arc<System>, rng: &mut impl Rng) -> (Arc<System>, Vec<f64>) {
    let varied = varied(system, &mut |what| what.range.draw(rng));
    varied.map_or_else(|| (system.clone(), Vec::new()), |(own, drawn)| (Arc::new(own), drawn))
}

/// Names of the numbers that [`draw`] draws, in order: `mass:LINK`, `friction`, `gain:JOINT`.
pub fn columns(system: &System) -> Vec<String> {
    let mut names = Vec::new();
    varied(system, &mut |Drawn { what, whose, range, .. }| {
        names.push(if whose.is_empty() { what.to_string() } else { format!("{what}:{whose}") });
        range.low
    });
    names
}

/// A varying parameter: quantity, link or joint, range, and nominal value from the robot's files.
struct Drawn<'a> {
    what: &'a str,
    whose: &'a str,
    range: Range,
    nominal: f64,
}

/// Parameters that a model may be conditioned on: all drawn numbers except torque ripple and the delay of observations.
/// Analytic solvers do not receive ripple either.
#[derive(Clone, Debug, Default)]
pub struct Told(Vec<(usize, Range, f64)>);

impl Told {
    /// The parameters of a system's family of robots.
    pub fn new(system: &System) -> Self {
        let mut told = Vec::new();
        let mut k = 0;
        varied(system, &mut |Drawn { what, range, nominal, .. }| {
            told.extend((!["ripple", "lag"].contains(what)).then_some((k, *range, *nominal)));
            k += 1;
            range.low
        });
        Self(told)
    }

    /// Number of parameters.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// Each parameter, mapped from its range to [-1, 1]. If `drawn` is empty, the nominal values are mapped, which may
    /// give numbers outside.
    pub fn numbers<'a>(&'a self, drawn: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        self.0.iter().map(|(k, Range { low, high }, nominal)| {
            let value = drawn.get(*k).unwrap_or(nominal);
            if high > low { (2.0 * value - low - high) / (high - low) } else { 0.0 }
        })
    }
}

/// A system with the numbers that `take` returns for each range of its `[vary]`, and these numbers; `None` without
/// `[vary]`.
fn varied(system: &System, take: &mut dyn FnMut(&Drawn) -> f64) -> Option<(System, Vec<f64>)> {
    let vary = system.spec.vary.as_ref()?;
    let mut own = system.clone();
    let mut drawn = Vec::new();
    let mut take = |what: &str, whose: &str, range: &Option<Range>, nominal: f64| {
        let x = take(&Drawn { what, whose, range: (*range)?, nominal });
        drawn.push(x);
        Some(x)
    };
    own.robot.links.iter_mut().for_each(|link| varied_link(link, vary, &mut take));
    varied_contact(&mut own, vary, &mut take);
    if let Some(size) = take("gravity", "", &vary.gravity, system.gravity().norm()) {
        own.spec.gravity = (own.gravity().normalize() * size).into();
    }
    let Motors { delay, strength, zeros, ripple, lines, noise, root_noise, lag } = &mut own.motors;
    for (joint, spec) in own.robot.joints_mut().zip(&mut own.spec.joints) {
        if let Some(factor) = take("gain", &joint.name, &vary.gain, 1.0) {
            spec.kp *= factor;
            spec.kd *= factor;
        }
        if let Some(factor) = take("joint_damping", &joint.name, &vary.joint_damping, 1.0) {
            joint.damping *= factor;
            joint.friction *= factor;
        }
        joint.armature += take("armature", &joint.name, &vary.armature, 0.0).unwrap_or(0.0);
        joint.damping += take("damping", &joint.name, &vary.damping, 0.0).unwrap_or(0.0);
        joint.friction += take("dry_friction", &joint.name, &vary.dry_friction, 0.0).unwrap_or(0.0);
        strength.extend(take("strength", &joint.name, &vary.strength, 1.0));
        zeros.extend(take("zero", &joint.name, &vary.zero, 0.0));
        lines.extend(
            take("top_speed", &joint.name, &vary.top_speed, f64::INFINITY).map(|top| [spec.torque_limit(joint), top]),
        );
        ripple.extend(take("ripple", &joint.name, &vary.ripple, 0.0));
    }
    *delay += take("delay", "", &vary.delay, 0.0).unwrap_or(0.0);
    *noise += take("noise", "", &vary.noise, 0.0).unwrap_or(0.0);
    root_noise[0] += take("root_noise", "", &vary.root_noise, 0.0).unwrap_or(0.0);
    root_noise[1] += take("orientation_noise", "", &vary.orientation_noise, 0.0).unwrap_or(0.0);
    *lag += take("lag", "", &vary.lag, 0.0).unwrap_or(0.0);
    own.drawn.clone_from(&drawn);
    Some((own, drawn))
}

/// Draws a number; arguments: name of the range, name of link or joint, range, nominal value. `None` without a range.
type Take<'a> = dyn FnMut(&str, &str, &Option<Range>, f64) -> Option<f64> + 'a;

fn varied_link(link: &mut Link, vary: &VarySpec, take: &mut Take) {
    let body = &mut link.inertia;
    if let Some(factor) = take("mass", &link.name, &vary.mass, 1.0) {
        body.mass *= factor;
        body.inertia *= factor;
        link.lifted.mass *= factor;
    }
    if let Some(factor) = take("inertia", &link.name, &vary.inertia, 1.0) {
        body.inertia *= factor;
    }
    let shift = ["com.x", "com.y", "com.z"].map(|what| take(what, &link.name, &vary.com, 0.0).unwrap_or_default());
    let shift = link.frame.rotation * Vector3::from(shift);
    body.com += shift;
    link.lifted.at += shift;
}

fn varied_contact(own: &mut System, vary: &VarySpec, take: &mut Take) {
    let friction = take("friction", "", &vary.friction, own.spec.material.friction);
    let stiffness = take("stiffness", "", &vary.stiffness, 1.0).unwrap_or(1.0);
    let damping = stiffness * take("contact_damping", "", &vary.contact_damping, 1.0).unwrap_or(1.0);
    let scenes = own.spec.scenes.iter_mut().filter_map(|s| s.material.as_mut());
    for material in scenes.chain([&mut own.spec.material]) {
        material.friction = friction.unwrap_or(material.friction);
        material.stiffness *= stiffness;
        material.damping *= damping;
    }
    own.one_friction = friction.or(own.one_friction);
}

/// A batch of `n` environments in the scene named `scene`, with parameters drawn for each environment. Without
/// `[vary]`, all environments share one robot.
pub fn batch(system: &Arc<System>, scene: &str, n: usize, seed: u64) -> Result<Batch, SystemError> {
    let mut batch = Batch::new(system, &system.scene(scene)?, n);
    if system.spec.vary.is_some() {
        batch.systems = (0..n).map(|env| draw(system, &mut stream(seed, env as u64)).0).collect();
        batch.scenes = batch.systems.iter().map(|own| own.scene(scene)).collect::<Result<_, _>>()?;
    }
    Ok(batch)
}
