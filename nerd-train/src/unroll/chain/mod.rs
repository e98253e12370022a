//! Cables ([`nerd_model::chain`]) in rollouts: a token per rod, motions turned and mirrored.

mod judge;
mod loss;
mod scales;
mod view;

use nerd_model::chain::{Chain, Gripper, INPUTS, Look, OUTPUTS, Outputs, Rods, chain_functions, numbers};
use nerd_sim::articulated::device::{Reach, record};

pub use judge::distance;
pub use loss::Loss;
pub use scales::scales;
pub use view::View;

use super::*;
use judge::{apart, missed};

/// Length of a rollout's row, see `Cable::row`.
pub const ROLLOUT: usize = 7;
/// Mean distance (m) of nodes from the truth beyond which a rollout restarts.
const ASTRAY: f64 = 0.03;

/// A cable in rollouts.
#[derive(Clone)]
pub struct Cable {
    /// Constants of the chain.
    pub chain: Chain,
    /// Scale of each network output: what an output of 1 means ([`scales`]).
    pub scale: [f64; OUTPUTS],
    /// Loss, with its units.
    pub loss: Loss,
}

impl Body for Cable {
    type View = View;
    type State = Rods;
    type Slope = Rods;
    type Look = Look;
    type Memory = ();

    fn memory(&self) {}

    fn tokens(&self) -> usize {
        self.chain.rods
    }

    fn view(&self, yaw: f64, mirrored: bool) -> View {
        let round = self.chain.round();
        View::new(if round { yaw } else { 0.0 }, round && mirrored)
    }

    fn truth(&self, motions: &Trajectories, Place { motion, frame, view }: &Place<View>) -> Rods {
        view.rods(&self.chain, &self.chain.rods(motions.state(*motion, *frame)))
    }

    fn look(
        &self,
        rods: &Rods,
        (motions, place): (&Trajectories, &Place<View>),
        (): &mut (),
        tokens: &mut Vec<f32>,
    ) -> Look {
        let Place { motion, frame, view } = place;
        let torques = view.torques(&self.chain, motions.torques(*motion, *frame));
        let scene = &motions.scenes[*motion];
        let look = Look::at(&self.chain, rods, &torques, |at| view.contact(&self.chain, scene, at));
        look.tokens(&self.chain, rods, tokens);
        look
    }

    fn advance(&self, before: &Rods, look: &Look, numbers: &[f32], (): &mut ()) -> Rods {
        self.chain.advance(before, &look.glided, Outputs { numbers, scale: &self.scale })
    }

    fn level(&self) -> Rods {
        Rods::zeros(self.chain.rods)
    }

    fn loss(&self, [predicted, truth]: [&Rods; 2], k: usize, weight: f64, gradient: &mut Rods) -> f64 {
        self.loss.of(&self.chain, (predicted, truth), k, weight, gradient)
    }

    fn join(&self, own: &mut Rods, upstream: &Rods, later: usize) {
        let norm = |rods: &Rods| {
            (square(rods.gripper.numbers()) + square(rods.along.iter().chain(&rods.rates).flatten().copied())).sqrt()
        };
        let share = join(norm(own), norm(upstream), later);
        own.gripper.numbers_mut().zip(upstream.gripper.numbers()).for_each(|(x, y)| *x += share * y);
        let pairs = own.along.iter_mut().chain(&mut own.rates).zip(upstream.along.iter().chain(&upstream.rates));
        pairs.for_each(|(x, y)| *x += y * share);
    }

    fn advance_back(&self, before: &Rods, numbers: &[f32], upstream: &Rods, gradient: &mut Rods) -> Vec<f32> {
        self.chain.advance_back(before, Outputs { numbers, scale: &self.scale }, upstream, gradient)
    }

    fn look_back(
        &self,
        before: &Rods,
        look: &Look,
        by_tokens: &[f32],
        upstream: &Rods,
        gradient: &mut Rods,
        (): &mut (),
    ) {
        // The gripper's glide, its motion under its drives alone, passes a gradient too.
        let mut glided: Gripper = look.tokens_back(&self.chain, before, by_tokens, gradient);
        glided.numbers_mut().zip(upstream.gripper.numbers()).for_each(|(x, g)| *x += g);
        let led = self.chain.glide_back(&glided);
        gradient.gripper.numbers_mut().zip(led.numbers()).for_each(|(x, g)| *x += g);
    }

    fn near(&self, rods: &Rods, truth: &Rods) -> bool {
        rods.finite() && apart(&self.chain, rods, truth) <= ASTRAY * self.chain.rods as f64
    }

    fn missed(&self, motions: &Trajectories, network: &Loaded, frames: usize) -> f64 {
        missed(&self.chain, motions, network, &self.scale, frames)
    }
}

/// Data and source of the kernels, which compute in f64.
impl Cable {
    /// Length of a chain's state on the device (numbers).
    pub fn width(&self) -> usize {
        numbers(&self.chain)
    }

    /// Kernel source, for scenes of at most `colliders` colliders.
    pub fn program(&self, system: &Arc<System>, colliders: usize) -> String {
        let mut text = chain_functions(&self.chain, &self.scale, system, colliders);
        let loss = &self.loss;
        for (name, x) in
            [("SHARE", loss.share), ("BY_RATE", loss.rate), ("BY_SPEED", loss.velocity), ("ASTRAY", ASTRAY)]
        {
            text += &format!("#define {name} {x:e}\n");
        }
        let led = loss.gripper.iter().map(|x| format!("{x:e}")).collect_vec();
        text += &format!("TABLE double BY_LED[] = {{{}}};\n", led.join(", "));
        text + include_str!("../shared.cuh") + include_str!("chain.cuh") + include_str!("chain_frame.cuh")
    }

    /// A scene as numbers for the kernels.
    pub fn record(&self, system: &System, scene: &Scene, colliders: usize) -> Result<Vec<f64>, String> {
        record(scene, system, Reach { colliders, ..Reach::default() })
    }

    /// A rollout's row for the device: motion, first frame of the update, whether it restarts, and its view.
    pub fn row(Place { motion, frame, view }: &Place<View>, anew: bool) -> [f64; ROLLOUT] {
        [*motion as f64, *frame as f64, f64::from(u8::from(anew)), view.mirror, view.sin, view.cos, view.yaw]
    }
}

fn square(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.map(|x| x * x).sum()
}
