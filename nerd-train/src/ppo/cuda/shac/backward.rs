//! [`BackwardPass`]: backward pass through a rollout on the device, as in `shac/back.rs`.

use nerd_model::program::Slot;
use nerd_sim::articulated::device::Back;

use super::*;

/// Mirror of `Steps` in `task_back.cuh`.
#[repr(C)]
#[derive(Clone, Copy)]
struct Fields {
    at: [u64; 22],
    scale: f64,
    outputs: i32,
    horizon: i32,
}

/// Memory of the backward pass in one world.
pub(super) struct BackwardPass {
    fields: Buffer<Fields>,
    shares: Buffer<f64>,
    asked: Buffer<i32>,
    by_seen: Buffer<f32>,
    by_rows: Buffer<f32>,
    slope: Buffer<f64>,
    pushed: Buffer<f64>,
    _kept: [Buffer<f64>; 2],
    by_spread: Buffer<f32>,
    /// `earned`: part of J by environment. `without`: nonzero for an environment that had a frame without finite
    /// gradients.
    pub earned: Buffer<f64>,
    pub without: Buffer<u32>,
    scale: f64,
    replays: [Replay; 3],
}

/// A rollout on the device, with its engine, world and solver.
#[derive(Clone, Copy)]
pub(super) struct Rolled<'a> {
    pub engine: &'a CudaEngine,
    pub world: &'a World,
    pub resident: &'a dyn Resident,
    pub config: &'a PpoConfig,
    /// Address of the weights of the target critic V'.
    pub target_critic: u64,
}

impl BackwardPass {
    pub fn new(engine: &CudaEngine, world: &World, robot: &Robot, config: &PpoConfig) -> DeviceResult<Self> {
        let kept = &engine.kept;
        let d = &engine.net.device;
        let a = engine.shape.action;
        let n = kept.environments;
        let width = engine.shape.inputs();
        let joints = robot.joint_count();
        let wide = 2 * robot.nv();
        let steps = n * kept.horizon;
        let reals = |len: usize| d.zeros::<f64>(len);
        let shares = reals(steps)?;
        let asked = d.zeros::<i32>(steps)?;
        let slope = reals(n * wide)?;
        let pushed = reals(n * joints)?;
        let (by_torques, by_action, by_spread) = (reals(n * joints)?, reals(n * a)?, d.zeros::<f32>(steps * a)?);
        let by_seen = d.zeros::<f32>(n * width)?;
        let by_rows = d.zeros::<f32>((1 + kept.slots) * n * width)?;
        let without = d.zeros::<u32>(n)?;
        let (trail, [goals, reached]) = world.trail();
        let Steps { actions, means, .. } = &engine.steps;
        let known = [
            trail.states,
            goals,
            trail.torques,
            reached,
            kept.observations.ptr,
            kept.rows.ptr,
            kept.seen[0].ptr,
            kept.seen[1].ptr,
        ];
        let of_steps = [shares.ptr, kept.ends.ptr, asked.ptr, actions.ptr, means.ptr, by_seen.ptr, by_rows.ptr];
        let found =
            [slope.ptr, by_torques.ptr, pushed.ptr, by_action.ptr, without.ptr, engine.net.targets.ptr, by_spread.ptr];
        let scale = 1.0 / config.steps() as f64;
        let outputs = engine.shape.outputs() as i32;
        let horizon = kept.horizon as i32;
        let at = [&known[..], &of_steps, &found]
            .concat()
            .try_into()
            .map_err(|_| DeviceError("fields of the way back".into()))?;
        let fields = d.upload(&[Fields { at, scale, outputs, horizon }])?;
        let earned = reals(n)?;
        let _kept = [by_torques, by_action];
        let replays = Default::default();
        Ok(Self {
            fields,
            shares,
            asked,
            by_seen,
            by_rows,
            slope,
            pushed,
            _kept,
            by_spread,
            earned,
            without,
            scale,
            replays,
        })
    }

    /// Evaluates V' and computes J, the gradient of `-J` with respect to bootstrap rows, the advantages and the
    /// returns.
    pub fn value(&self, of: Rolled) -> DeviceResult {
        self.replays[0].run(&of.engine.net.device, "values", (), || self.values(of))
    }

    /// Evaluates policy and solver again at all steps, as preparation of `back`.
    pub fn recall(&self, of: Rolled) -> DeviceResult {
        let Rolled { engine, world, resident, .. } = of;
        let net = &engine.net;
        let kept = &engine.kept;
        self.replays[1].run(&net.device, "recall", (), || {
            engine.ask(engine.weights.ptr, kept.observations.ptr, net.at(Slot(0)), kept.environments * kept.horizon)?;
            resident.recall(world.trail().0)
        })
    }

    /// Computes the gradient of `-J` with respect to the policy's parameters.
    pub fn back(&self, of: Rolled) -> DeviceResult {
        self.replays[2].run(&of.engine.net.device, "way back", (), || self.through(of))
    }

    fn values(&self, Rolled { engine, config, target_critic, .. }: Rolled) -> DeviceResult {
        let net = &engine.net;
        let kept = &engine.kept;
        let n = kept.environments;
        let a = engine.shape.action;
        let steps = kept.environments * kept.horizon;
        let rows = (1 + kept.slots) * kept.environments;
        engine.reached(target_critic)?;
        let Self { shares, asked, earned, without, scale, .. } = self;
        let read = args![&kept.rewards, &kept.ends, &kept.values, &kept.units];
        let written = args![shares, asked, &net.targets, earned, without];
        let sizes = args![n, kept.horizon, kept.slots, a, engine.shape.outputs(), config.gamma, *scale];
        engine.over("shac_ahead", n, &[&read[..], &written, &sizes].concat())?;
        net.backward(target_critic, None, 0..rows, Some(self.by_rows.ptr))?;
        net.forward_from(engine.steps.inputs.ptr, target_critic, steps)?;
        engine.value(0, kept.values.ptr, steps)?;
        engine.finished(config)
    }

    fn through(&self, Rolled { engine, world, resident, .. }: Rolled) -> DeviceResult {
        let net = &engine.net;
        let n = engine.kept.environments;
        let horizon = engine.kept.horizon;
        let frames = world.frames();
        let weights = engine.weights.ptr;
        let steps = self.fields.ptr;
        let trail = world.trail().0;
        let [slope, by_torques] = [self.slope.ptr, self.pushed.ptr];
        for t in (0..horizon).rev() {
            world.back("task_arrive_back", 1, steps, &args![t])?;
            for frame in (t * frames..(t + 1) * frames).rev() {
                resident.back(
                    trail,
                    Back { frame, rows: 1, grad_next: slope, by_states: slope, by_torques, next: [0; 2] },
                )?;
                world.back("task_acted_back", 1, steps, &args![frame])?;
            }
            if t > 0 {
                net.backward(weights, None, t * n..(t + 1) * n, Some(self.by_seen.ptr))?;
            }
        }
        world.back("task_leave", horizon, steps, &[])?;
        net.backward(weights, Some(engine.gradient.ptr), 0..horizon * n, None)?;
        let a = engine.shape.action;
        net.sum_rows(self.by_spread.ptr, horizon * n, a, Some(engine.gradient.at(engine.weights.len - a)), None)
    }

    /// Begins the next episode in environments without gradients, and writes its observation.
    pub fn begin_again(&self, of: Rolled) -> DeviceResult {
        of.world.back("task_begin_again", 1, self.fields.ptr, &args![&of.engine.kept.rows])
    }
}
