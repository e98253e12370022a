//! A robot in its scene under a solver, with parameters set.

use super::parameter::{CalibrateError, Parameter, What, round};
use crate::{articulated::numbers, internal::*, scene::PlaneSpec, system::motors::late};

/// A solver and its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    /// `articulated`.
    Articulated(ArticulatedConfig),
    /// rapier.
    Rapier(RapierConfig),
}

impl Engine {
    /// The solver.
    pub fn solver(&self) -> Box<dyn Solver> {
        match *self {
            Self::Articulated(config) => Box::new(Articulated::new(config)),
            Self::Rapier(config) => Box::new(Rapier::new(config)),
        }
    }
}

/// A robot, scene and solver to be compared with measurements.
#[derive(Clone)]
pub struct Subject {
    /// The robot.
    pub system: Arc<System>,
    /// Its scene.
    pub scene: Arc<Scene>,
    /// Its solver.
    pub engine: Engine,
    /// Frames by which measured velocities are older than their poses.
    pub lag: f64,
    /// Frames by which torques act late, from 0 to 2.
    pub delay: f64,
    /// Positions of the joints where their sensors show 0 (rad or m).
    pub zeros: Vec<f64>,
    /// Factors on the torques of the joints.
    pub strength: Vec<f64>,
}

impl Subject {
    /// A robot as its files have it.
    pub fn new(system: &Arc<System>, scene: &str, engine: Engine) -> Result<Self, CalibrateError> {
        let [zeros, strength] = [0.0, 1.0].map(|value| vec![value; system.robot.joint_count()]);
        Ok(Self { scene: system.scene(scene)?, system: system.clone(), engine, lag: 0.0, delay: 0.0, zeros, strength })
    }

    /// The same with these values of the parameters.
    pub fn with(&self, parameters: &[Parameter], values: &[f64]) -> Result<Self, CalibrateError> {
        let (mut system, mut engine, mut lag) = ((*self.system).clone(), self.engine, self.lag);
        let (mut delay, mut zeros, mut strength) = (self.delay, self.zeros.clone(), self.strength.clone());
        // Before every length is used.
        for (_, &value) in parameters.iter().zip(values).filter(|(p, _)| p.what == What::Size) {
            system.robot.scale(value);
            system.folds.scale(value);
        }
        for (p, &value) in parameters.iter().zip(values) {
            // The robot's material, and the scene's own if it has one: a pair acts with their mean.
            let own = system.spec.scenes.iter_mut().filter(|s| s.name == self.scene.name).filter_map(|s| s.material.as_mut());
            for material in own.chain([&mut system.spec.material]) {
                match p.what {
                    What::Friction => material.friction = value,
                    What::Stiffness => material.stiffness = value,
                    What::Damping => material.damping = value,
                    What::FrictionDamping => material.friction_damping = value,
                    _ => {}
                }
            }
            match p.what {
                // Also for each pair whose friction a file sets.
                What::Friction => system.one_friction = Some(value),
                What::Size | What::Stiffness | What::Damping | What::FrictionDamping => {}
                What::Mass(link) => {
                    let Link { inertia, lifted, .. } = &mut system.robot.links[link];
                    inertia.inertia *= value / inertia.mass;
                    lifted.mass *= value / inertia.mass;
                    inertia.mass = value;
                }
                What::Com(link, axis) => {
                    let Link { frame, inertia, lifted, .. } = &mut system.robot.links[link];
                    let mut com = frame.inverse_transform_point(&inertia.com.into());
                    com[axis] = value;
                    let com = frame.transform_point(&com).coords;
                    lifted.at += com - inertia.com;
                    inertia.com = com;
                }
                What::Inertia(link) => system.robot.links[link].inertia.inertia *= value,
                What::Spread(link, axis) => {
                    let Link { frame, inertia, .. } = &mut system.robot.links[link];
                    let turn = frame.rotation.to_rotation_matrix();
                    let mut own = BodyInertia { inertia: turn.inverse() * inertia.inertia * turn, ..*inertia };
                    own.spread(axis, value);
                    inertia.inertia = turn * own.inertia * turn.inverse();
                }
                What::Rounding => round(&mut system, value),
                What::Gravity => {
                    let g = system.gravity();
                    system.spec.gravity = (g * (value / g.norm())).into();
                }
                What::Height => self.plane(&mut system, p)?.height += value,
                What::Tilt(axis) => self.plane(&mut system, p)?.angles[axis] += value,
                What::Lag => lag = value,
                What::Delay => delay = value,
                What::Zero(joint) => zeros[joint] = value,
                What::Strength(joint) => strength[joint] = value,
                What::JointDamping(joint) => system.robot.joints_mut().nth(joint).into_iter().for_each(|j| j.damping = value),
                What::Armature(joint) => system.robot.joints_mut().nth(joint).into_iter().for_each(|j| j.armature = value),
                What::JointFriction(joint) => system.robot.joints_mut().nth(joint).into_iter().for_each(|j| j.friction = value),
                What::Restitution => {}
            }
            let foreign = match &mut engine {
                Engine::Rapier(config) if p.what == What::Restitution => {
                    config.restitution = value;
                    false
                }
                Engine::Rapier(_) => {
                    matches!(p.what, What::Rounding | What::Stiffness | What::Damping | What::FrictionDamping | What::JointFriction(_))
                }
                Engine::Articulated(_) => p.what == What::Restitution,
            };
            if foreign {
                return Err(CalibrateError::Parameter(format!("parameter `{}` means nothing to this solver; leave it out", p.name)));
            }
        }
        let system = Arc::new(system);
        // A randomly drawn scene is not one of the robot's, and is kept.
        let scene = if self.scene.name == "random" { self.scene.clone() } else { system.scene(&self.scene.name)? };
        Ok(Self { scene, system, engine, lag, delay, zeros, strength })
    }

    /// The torques that act in a frame under a delay; `asked` are the commanded ones of the last three frames, the newest first.
    pub fn late(&self, asked: &[&[f64]; 3]) -> Vec<f64> {
        let mut out = vec![0.0; asked[0].len()];
        late(self.delay, asked, &mut out);
        out.iter_mut().zip(&self.strength).for_each(|(tau, factor)| *tau *= factor);
        out
    }

    /// Converts a pose to sensor readings, or with `side` 1 readings to the pose.
    pub fn shift(&self, pose: &mut [f64], side: f64) {
        let first = self.system.robot.root_coords();
        pose[first..].iter_mut().zip(&self.zeros).for_each(|(q, zero)| *q += side * zero);
    }

    /// Derivatives of the numbers of robot and scene ([`numbers`]) with respect to each parameter at these values: `[parameter][number]`.
    /// They turn gradients with respect to numbers ([`Articulated::back_by_numbers`]) into gradients with respect to parameters. Central
    /// differences of the numbers; no solver is involved.
    pub fn numbers_by(&self, parameters: &[Parameter], values: &[f64]) -> Result<Vec<Vec<f64>>, CalibrateError> {
        let by = |k: usize| {
            let size = 1e-5 * (parameters[k].high - parameters[k].low);
            let side = |size: f64| {
                let mut values = values.to_vec();
                values[k] += size;
                self.with(parameters, &values).map(|subject| numbers(&subject.system, &subject.scene))
            };
            let [up, down] = [side(size)?, side(-size)?];
            Ok(up.iter().zip(down).map(|(up, down)| (up - down) / (2.0 * size)).collect())
        };
        (0..parameters.len()).map(by).collect()
    }

    /// The plane of a system's own scene that a parameter moves.
    fn plane<'a>(&self, system: &'a mut System, p: &Parameter) -> Result<&'a mut PlaneSpec, CalibrateError> {
        let own = system.spec.scenes.iter_mut().find(|s| s.name == self.scene.name);
        own.map(|scene| &mut scene.plane).ok_or_else(|| CalibrateError::idle(&p.name))
    }
}
