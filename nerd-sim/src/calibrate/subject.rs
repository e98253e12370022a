//! A robot in its scene under a solver, with parameters set to given values.

use super::parameter::{CalibrateError, Parameter, What, round};
use crate::{articulated::numbers, internal::*, scene::PlaneSpec, system::motors::late};

/// A solver with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    /// `articulated`.
    Articulated(ArticulatedConfig),
    /// rapier.
    Rapier(RapierConfig),
}

impl Engine {
    /// Builds the solver.
    pub fn solver(&self) -> Box<dyn Solver> {
        match *self {
            Self::Articulated(config) => Box::new(Articulated::new(config)),
            Self::Rapier(config) => Box::new(Rapier::new(config)),
        }
    }
}

/// A robot in a scene under a solver, to be compared with measurements.
#[derive(Clone)]
pub struct Subject {
    /// The robot.
    pub system: Arc<System>,
    /// Name resolved to the scene of the robot.
    pub scene: Arc<Scene>,
    /// Solver and settings.
    pub engine: Engine,
    /// Frames by which measured velocities are older than their poses.
    pub lag: f64,
    /// Delay of torques (frames), 0 to 2.
    pub delay: f64,
    /// Joint positions (rad or m) where the sensors read 0.
    pub zeros: Vec<f64>,
    /// Factor on the torque of each joint.
    pub strength: Vec<f64>,
}

impl Subject {
    /// A robot with nominal parameters.
    pub fn new(system: &Arc<System>, scene: &str, engine: Engine) -> Result<Self, CalibrateError> {
        let [zeros, strength] = [0.0, 1.0].map(|value| vec![value; system.robot.joint_count()]);
        Ok(Self { scene: system.scene(scene)?, system: system.clone(), engine, lag: 0.0, delay: 0.0, zeros, strength })
    }

    /// The subject with these values of the parameters.
    pub fn with(&self, parameters: &[Parameter], values: &[f64]) -> Result<Self, CalibrateError> {
        let (mut system, mut engine, mut lag) = ((*self.system).clone(), self.engine, self.lag);
        let (mut delay, mut zeros, mut strength) = (self.delay, self.zeros.clone(), self.strength.clone());
        // Scale first: other parameters use the scaled lengths.
        for (_, &value) in parameters.iter().zip(values).filter(|(p, _)| p.what == What::Size) {
            system.robot.scale(value);
            system.folds.scale(value);
        }
        for (p, &value) in parameters.iter().zip(values) {
            // The robot's material, and the scene's material if it has one, since a pair acts with their mean.
            let own =
                system.spec.scenes.iter_mut().filter(|s| s.name == self.scene.name).filter_map(|s| s.material.as_mut());
            for material in own.chain([&mut system.spec.material]) {
                match p.what {
                    What::Friction => material.friction = value,
                    What::Stiffness => material.stiffness = value,
                    What::Damping => material.damping = value,
                    _ => {}
                }
            }
            match p.what {
                // Also replaces friction coefficients that the robot's file sets for pairs.
                What::Friction => system.one_friction = Some(value),
                What::Size | What::Stiffness | What::Damping => {}
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
                What::JointDamping(joint) => {
                    system.robot.joints_mut().nth(joint).into_iter().for_each(|j| j.damping = value)
                }
                What::Armature(joint) => {
                    system.robot.joints_mut().nth(joint).into_iter().for_each(|j| j.armature = value)
                }
                What::JointFriction(joint) => {
                    system.robot.joints_mut().nth(joint).into_iter().for_each(|j| j.friction = value)
                }
                What::Restitution => {}
            }
            let foreign = match &mut engine {
                Engine::Rapier(config) if p.what == What::Restitution => {
                    config.restitution = value;
                    false
                }
                Engine::Rapier(_) => {
                    matches!(p.what, What::Rounding | What::Stiffness | What::Damping | What::JointFriction(_))
                }
                Engine::Articulated(_) => p.what == What::Restitution,
            };
            if foreign {
                return Err(CalibrateError::Parameter(format!(
                    "parameter `{}` means nothing to this solver; leave it out",
                    p.name
                )));
            }
        }
        let system = Arc::new(system);
        // A random scene is not built from the robot's specification, so it stays.
        let scene = if self.scene.name == "random" { self.scene.clone() } else { system.scene(&self.scene.name)? };
        Ok(Self { scene, system, engine, lag, delay, zeros, strength })
    }

    /// The delayed and scaled torques of a frame; `asked` are the commanded torques of the last three frames, newest
    /// first.
    pub fn late(&self, asked: &[&[f64]; 3]) -> Vec<f64> {
        let mut out = vec![0.0; asked[0].len()];
        late(self.delay, asked, &mut out);
        out.iter_mut().zip(&self.strength).for_each(|(tau, factor)| *tau *= factor);
        out
    }

    /// Converts joint positions to sensor readings (`side` -1) or readings to joint positions (1).
    pub fn shift(&self, pose: &mut [f64], side: f64) {
        let first = self.system.robot.root_coords();
        pose[first..].iter_mut().zip(&self.zeros).for_each(|(q, zero)| *q += side * zero);
    }

    /// Derivatives `[parameter][number]` of the numbers of robot and scene ([`numbers`]) with respect to each parameter
    /// at `values`. Uses central differences, without a solver. They convert gradients with respect to numbers
    /// ([`Articulated::back_by_numbers`]) to gradients with respect to parameters.
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

    /// The plane of the scene in the system's specification; an error names the parameter if there is none.
    fn plane<'a>(&self, system: &'a mut System, p: &Parameter) -> Result<&'a mut PlaneSpec, CalibrateError> {
        let own = system.spec.scenes.iter_mut().find(|s| s.name == self.scene.name);
        own.map(|scene| &mut scene.plane).ok_or_else(|| CalibrateError::idle(&p.name))
    }
}
