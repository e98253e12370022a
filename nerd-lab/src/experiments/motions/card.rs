//! The same motions on a GPU: many environments together, the motions in turn, which stay there for ten frames at a time.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nerd_model::pick::Setting;
use nerd_sim::articulated::device::Real;
use nerd_sim::prelude::*;

use super::{Motions, Places, points};
use crate::error::Result;
use crate::experiments::cost::each;
use nerd_train::device::resident;
use nerd_train::learner::cuda::Precision;

/// Products of a learned solver's network, each with what it is called behind the solver's name; an analytic one has none.
pub(super) fn products(setting: &Setting) -> &'static [(Precision, &'static str)] {
    let all = &[(Precision::F32, ""), (Precision::Tf32, ", TF32")];
    if matches!(setting, Setting::Neural(_)) { all } else { &all[..1] }
}

impl Motions {
    /// As [`Motions::rolled`], of a solver on the card, timed with as many environments as are asked for; transfers count.
    pub(super) fn rolled_there(
        &self,
        start: &Batch,
        (setting, precision): (&Setting, Precision),
        torques: &[f64],
    ) -> Result<(Places, f64, Vec<bool>)> {
        let (look, joints) = (self.look(), start.system.robot.joint_count());
        let mut crowd = self.crowd(start);
        let (n, looks) = (crowd.len(), self.frames / look);
        let mut solver = resident(setting, &start.system, Real::F32, precision)?;
        // `[frame][env][joint]` up to a look.
        let part = |k: usize| -> Vec<f64> {
            let of = |frame: usize, env: usize| &torques[(env % self.starts * self.frames + frame) * joints..][..joints];
            (k * look..(k + 1) * look).flat_map(|frame| (0..n).flat_map(move |env| of(frame, env).iter().copied())).collect()
        };
        // Kernels are compiled and memory taken once, before the clock runs.
        if let Err(error) = solver.roll(&mut crowd.clone(), &part(0), look) {
            error.faults()?;
        }
        (0..n).for_each(|env| solver.reset(env));
        let (mut lost, mut places, mut spent) = (vec![false; self.starts], Vec::new(), Duration::ZERO);
        for torques in (0..looks).map(part) {
            let began = Instant::now();
            let rolled = solver.roll(&mut crowd, &torques, look);
            spent += began.elapsed();
            if let Err(error) = rolled {
                for fault in error.faults()? {
                    lost[fault.env % self.starts] = true;
                    crowd.reset(fault.env, start.state(fault.env % self.starts));
                    solver.reset(fault.env);
                }
            }
            places.push((0..self.starts).map(|env| points(&crowd.system, crowd.state(env))).collect());
        }
        Ok((places, each(spent, n * looks * look), lost))
    }

    /// The motions' starts, in turn.
    fn crowd(&self, start: &Batch) -> Batch {
        let n = self.together();
        let mut crowd = Batch::new(&start.system, &start.scenes[0], n);
        for env in 0..n {
            crowd.reset(env, start.state(env % self.starts));
            crowd.scenes[env] = Arc::clone(&start.scenes[env % self.starts]);
        }
        crowd
    }
}
