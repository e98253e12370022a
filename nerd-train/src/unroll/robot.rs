//! Robots with one token per frame; the network predicts a change of state. Contacts are detected anew in every
//! predicted state.

use nerd_core::state::wrap_state;
use nerd_core::tangent::{difference, difference_back};
use nerd_model::around::Around;

use super::*;

/// Unit of errors, as a share f of the mean change over a frame.
const SHARE: f64 = 0.02;
/// Largest number of frames, roughly, that units are measured in.
const FRAMES: usize = 8000;
/// Smallest unit: avoids division by 0 for numbers that never change.
const LEAST: f64 = 1e-9;

/// A robot in rollouts.
///
/// The loss of frame k is a sum of six means of `p(e / 2 f u sqrt k)`. Here `p(e) = sqrt(1 + e^2) - 1` and f = 0.02.
/// The means are over root rotation, root translation and joints, each for pose and velocity. The error e is that of
/// the predicted state in the tangent space of the truth ([`difference`]). For a velocity, u is its mean change over a
/// frame (m/s or rad/s). For a pose, u is that change times the frame time.
#[derive(Clone)]
pub struct Robot {
    /// Robot, form and normaliser.
    pub around: Around,
    /// Unit u of each number of the tangent space.
    pub units: Vec<f64>,
    /// Weight of each number of the tangent space in the loss.
    weights: Vec<f64>,
}

impl Robot {
    /// Measures units in `motions`.
    pub fn new(system: &Arc<System>, form: impl Into<Form>, normalizer: &Normalizer, motions: &Trajectories) -> Self {
        let nv = system.robot.nv();
        let dofs = system.robot.root_dofs();
        let step = (motions.count * motions.frames).div_ceil(FRAMES).max(1);
        let rows = (0..motions.count * motions.frames).step_by(step).collect_vec();
        let mut units = vec![0.0; 2 * nv];
        for row in &rows {
            let [motion, frame] = [row / motions.frames, row % motions.frames];
            let change = difference(&system.robot, motions.state(motion, frame), motions.state(motion, frame + 1));
            units[nv..].iter_mut().zip(&change[nv..]).for_each(|(unit, x)| *unit += x.abs() / rows.len() as f64);
        }
        for k in 0..nv {
            units[nv + k] = units[nv + k].max(LEAST);
            units[k] = units[nv + k] * system.frame_time;
        }
        let weight = |k: usize| 1.0 / if k % nv < dofs { 3.0 } else { (nv - dofs) as f64 };
        let weights = (0..2 * nv).map(weight).collect();
        Self {
            around: Around { system: system.clone(), form: form.into(), normalizer: normalizer.clone() },
            units,
            weights,
        }
    }

    fn norm(&self, gradient: &[f64]) -> f64 {
        gradient.iter().zip(&self.units).map(|(g, unit)| (g * unit).powi(2)).sum::<f64>().sqrt()
    }
}

/// Contacts and gravity of an observed state.
pub struct Looked {
    contacts: Vec<ContactEvent>,
    gravity: Vector3<f64>,
}

/// Working memory of a thread.
pub struct Scratch {
    features: Features,
    data: Data,
}

impl Body for Robot {
    type View = ();
    type State = Vec<f64>;
    type Slope = Vec<f64>;
    type Look = Looked;
    type Memory = Scratch;

    fn memory(&self) -> Scratch {
        Scratch {
            features: Features::new(&self.around.system, self.around.form),
            data: Data::new(&self.around.system.robot),
        }
    }

    fn tokens(&self) -> usize {
        1
    }

    fn view(&self, _: f64, _: bool) {}

    fn truth(&self, motions: &Trajectories, place: &Place<()>) -> Vec<f64> {
        motions.state(place.motion, place.frame).to_vec()
    }

    fn look(
        &self,
        state: &Vec<f64>,
        (motions, place): (&Trajectories, &Place<()>),
        memory: &mut Scratch,
        tokens: &mut Vec<f32>,
    ) -> Looked {
        let mut events = Vec::new();
        let scene = &motions.scenes[place.motion];
        if !self.around.system.robot.contact_points.is_empty() {
            contacts(&self.around.system, scene, state, &mut memory.data, &mut events);
        }
        let first = tokens.len();
        tokens.resize(first + self.around.normalizer.inputs.mean.len(), 0.0);
        let torques = motions.torques(place.motion, place.frame);
        memory.features.token(state, &events, torques, &scene.gravity, &mut tokens[first..]);
        self.around.normalizer.inputs.normalize(&mut tokens[first..]);
        Looked { contacts: events, gravity: scene.gravity }
    }

    fn advance(&self, before: &Vec<f64>, _: &Looked, outputs: &[f32], scratch: &mut Scratch) -> Vec<f64> {
        let mut next = vec![0.0; before.len()];
        scratch.features.apply(before, &self.around.change(outputs).collect_vec(), &mut next);
        wrap_state(&self.around.system.robot, &mut next);
        next
    }

    fn level(&self) -> Vec<f64> {
        vec![0.0; self.units.len()]
    }

    fn loss(&self, [predicted, truth]: [&Vec<f64>; 2], k: usize, weight: f64, gradient: &mut Vec<f64>) -> f64 {
        let q = 2.0 * SHARE * (k as f64).sqrt();
        let (error, mut by_error) = (difference(&self.around.system.robot, truth, predicted), self.level());
        let numbers = izip!(&error, &self.units, &self.weights, &mut by_error);
        let total = numbers.map(|(e, unit, share, by)| bent(*e, unit * q, weight * share, by)).sum();
        difference_back(&self.around.system.robot, truth, predicted, &by_error, gradient);
        total
    }

    fn join(&self, own: &mut Vec<f64>, upstream: &Vec<f64>, later: usize) {
        let share = join(self.norm(own), self.norm(upstream), later);
        own.iter_mut().zip(upstream).for_each(|(x, y)| *x += share * y);
    }

    fn advance_back(
        &self,
        before: &Vec<f64>,
        outputs: &[f32],
        upstream: &Vec<f64>,
        gradient: &mut Vec<f64>,
    ) -> Vec<f32> {
        self.around.outputs_back(before, outputs, upstream, gradient)
    }

    fn look_back(
        &self,
        before: &Vec<f64>,
        Looked { contacts, gravity }: &Looked,
        by_tokens: &[f32],
        _: &Vec<f64>,
        gradient: &mut Vec<f64>,
        scratch: &mut Scratch,
    ) {
        self.around.token_back(before, (contacts, *gravity), by_tokens, &mut scratch.data, gradient);
    }

    /// Never continues a rollout. The error of a free body grows by itself, and training on such states would degrade
    /// predictions of single frames.
    fn near(&self, _: &Vec<f64>, _: &Vec<f64>) -> bool {
        false
    }

    fn missed(&self, motions: &Trajectories, network: &Loaded, frames: usize) -> f64 {
        ratio(
            motions,
            frames,
            || (self.memory(), Memory::default()),
            |(scratch, memory), motion, frame| {
                let place = Place { motion, frame, view: () };
                let before = self.truth(motions, &place);
                let mut tokens = Vec::new();
                let events = self.look(&before, (motions, &place), scratch, &mut tokens);
                let outputs = network.forward(&tokens, memory, Pass::Kept(1)).clone();
                let after = self.advance(&before, &events, &outputs, scratch);
                let truth = self.truth(motions, &Place { frame: frame + 1, ..place });
                let size = |a: &[f64], b: &[f64]| {
                    let error = difference(&self.around.system.robot, a, b);
                    let velocities = error.iter().zip(&self.units).skip(error.len() / 2);
                    velocities.map(|(e, unit)| (e / unit).abs()).sum::<f64>()
                };
                (size(&truth, &after), size(&truth, &before))
            },
        )
    }
}
