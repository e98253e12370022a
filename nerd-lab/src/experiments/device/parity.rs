//! One frame from the same states, on the device and on the CPU.

use nerd_model::pick::Setting;
use nerd_sim::articulated::device::Real;
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::Result;
use nerd_train::device::resident;
use nerd_train::learner::cuda::Precision;

/// Difference beyond which a state of 32 bits counts as apart.
const NEAR: f64 = 1e-4;

/// One robot and solver.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Parity {
    /// Robot and scene.
    pub of: String,
    /// The solver.
    pub solver: String,
    /// Share of the states in which something touches.
    pub touching: f64,
    /// The largest difference of a number, relative to 1 + its size, with 64 bits.
    pub double: f64,
    /// With 32 bits: that, its median over states, and the share of states beyond 1e-4.
    pub single: [f64; 3],
}

/// Compares.
pub(super) fn measure(of: &str, setting: &Setting, batch: &Batch) -> Result<Parity> {
    let (system, d) = (&batch.system, batch.system.robot.state_dim());
    let gains: Vec<f64> = system.joint_specs().map(|j| j.torque / 4.0).collect();
    let torques: Vec<f64> = (0..batch.len() * gains.len()).map(|k| gains[k % gains.len()] * (k as f64 * 0.7).sin()).collect();
    let mut watched = batch.clone();
    watched.watch();
    Articulated::new(ArticulatedConfig::accurate(system)).step(&mut watched, &torques)?;
    let touching = (0..batch.len()).filter(|env| watched.forces_on(*env).iter().any(|f| f.norm() > 0.0)).count() as f64;
    let mut cpu = batch.clone();
    setting.solver(system)?.step(&mut cpu, &torques)?;
    let apart = |real: Real| -> Result<Vec<f64>> {
        let mut device = batch.clone();
        resident(setting, system, real, Precision::F32)?.step(&mut device, &torques)?;
        let largest = |(a, b): (&[f64], &[f64])| a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max);
        let mut all: Vec<f64> = device.states.chunks_exact(d).zip(cpu.states.chunks_exact(d)).map(largest).collect();
        all.sort_by(f64::total_cmp);
        Ok(all)
    };
    let (double, single) = (apart(Real::F64)?, apart(Real::F32)?);
    let last = |all: &[f64]| all.last().copied().unwrap_or(0.0);
    let beyond = single.iter().filter(|x| **x > NEAR).count() as f64 / single.len() as f64;
    Ok(Parity {
        of: of.into(),
        solver: setting.to_string(),
        touching: touching / batch.len() as f64,
        double: last(&double),
        single: [last(&single), single[single.len() / 2], beyond],
    })
}

impl Parity {
    /// A row of the table.
    pub(super) fn cells(&self) -> Vec<String> {
        let percent = |x: f64| format!("{:.1}", 100.0 * x);
        let [single, median, beyond] = self.single;
        let small = [self.double, single, median].map(|x| format!("{x:.1e}"));
        [self.of.clone(), self.solver.clone(), percent(self.touching)].into_iter().chain(small).chain([percent(beyond)]).collect()
    }
}
