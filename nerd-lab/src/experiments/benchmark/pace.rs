//! What settings cost on a card, and how accurate they are there.

use nerd_core::state::difference;
use nerd_sim::articulated::device::Real;
use nerd_train::{device::resident, learner::cuda::Precision};

use super::Benchmark;
use crate::prelude::*;
use crate::report::{Mark, unbeaten};
use crate::roll::{begun, idle, rolled};

/// Frames after which most robots touch something: there rollouts begin.
const FALL: usize = 25;
/// Frames of a rollout whose error is measured, and at every how many of them it is looked at.
const FRAMES: usize = 100;
const LOOK: usize = 10;

#[derive(Clone, Debug, Serialize)]
pub(super) struct Pace {
    of: String,
    /// The solver, as a legend has it, and which of the series.
    series: String,
    label: String,
    /// Mean distance (rad, m) from the reference over a rollout: the CPU's solver, the card's.
    errors: [Option<f64>; 2],
    /// Frames a second of all environments: the CPU's on all cores, the card's.
    frames: [Option<f64>; 2],
    /// Environments of the timed batch that were given up.
    lost: usize,
    /// Whether no other of the robot beats it in both.
    front: bool,
}

pub(super) struct Course<'a> {
    of: String,
    system: Arc<System>,
    batch: Batch,
    asked: &'a Benchmark,
}

impl<'a> Course<'a> {
    pub fn new(robot: &str, scene: &str, asked: &'a Benchmark) -> Result<Self> {
        let system = System::named(robot)?;
        let batch = begun(&system, &system.scene(scene)?, asked.rollouts, Start::Sample, asked.seed);
        let batch = rolled(batch, &mut Articulated::new(ArticulatedConfig::accurate(&system)), FALL)?;
        Ok(Self { of: format!("{robot}, {scene}"), system, batch, asked })
    }

    pub fn touching(&self) -> bool {
        !self.system.robot.contact_points.is_empty() && !self.batch.scenes[0].colliders.is_empty()
    }

    pub fn ours(&self, settings: &[Setting]) -> Result<Vec<Pace>> {
        let (system, n) = (&self.system, self.asked.environments);
        let truth = states(&mut Articulated::new(ArticulatedConfig::converged(Friction::Coulomb)), self.batch.clone())?;
        let mut paces = Vec::new();
        for setting in settings {
            let all = [Precision::F32, Precision::Tf32, Precision::F16];
            for precision in if matches!(setting, Setting::Neural(_)) { &all[..] } else { &all[..1] } {
                let (mut cpu, mut card) = (setting.solver(system)?, resident(setting, system, Real::F32, *precision)?);
                let alone = *precision == Precision::F32;
                let error = |states: Vec<Vec<f64>>| Some(distance(system, &truth, &states));
                let on_cpu = if alone { error(states(&mut *cpu, self.batch.clone())?) } else { None };
                let errors = [on_cpu, error(states(&mut *card, self.batch.clone())?)];
                let mut many = self.crowd(n);
                let torques = idle(&many);
                // Kernels are compiled and memory taken once.
                left(card.roll(&mut many, &torques, 1))?;
                let mut one = many.clone();
                let steps = || (0..LOOK).try_for_each(|_| left(cpu.step(&mut one, &torques)).map(drop));
                let slow = if alone { Some(rate(n * LOOK, steps)?) } else { None };
                let mut lost = 0;
                let fast = rate(n * FRAMES, || {
                    lost = left(card.roll(&mut many, &torques, FRAMES))?;
                    Ok(())
                })?;
                let label = match setting {
                    Setting::Neural(folder) => {
                        let word = [", TF32", ", f16"][usize::from(*precision == Precision::F16)];
                        format!("{}{}", folder.file_name().unwrap_or_default().to_string_lossy(), if alone { "" } else { word })
                    }
                    other => format!("x{}", other.substeps().unwrap_or(1)),
                };
                let (of, series) = (self.of.clone(), setting.series().into());
                paces.push(Pace { of, series, label, errors, frames: [slow, Some(fast)], lost, front: false });
            }
        }
        Ok(paces)
    }

    fn crowd(&self, n: usize) -> Batch {
        let mut crowd = Batch::new(&self.system, &self.batch.scenes[0], n);
        let d = self.system.robot.state_dim();
        crowd.states.chunks_exact_mut(d).zip(self.batch.states.chunks_exact(d).cycle()).for_each(|(to, from)| to.copy_from_slice(from));
        crowd
    }
}

/// Marks what nothing else of one robot beats in both.
pub(super) fn mark(paces: &mut [Pace]) {
    let race: Vec<_> = paces.iter().map(|p| p.microseconds().zip(p.errors[1]).filter(|_| p.lost == 0)).collect();
    paces.iter_mut().zip(unbeaten(&race)).for_each(|(p, front)| p.front = front);
}

/// How many environments could not be stepped; they stay where they were.
fn left(stepped: Result<(), StepError>) -> Result<usize> {
    Ok(stepped.err().map_or(Ok(Vec::new()), StepError::faults)?.len())
}

fn rate(work: usize, run: impl FnOnce() -> Result<()>) -> Result<f64> {
    let began = Instant::now();
    run()?;
    Ok(work as f64 / began.elapsed().as_secs_f64())
}

/// States at every so many frames of a rollout.
fn states(solver: &mut dyn Solver, mut batch: Batch) -> Result<Vec<Vec<f64>>> {
    let torques = idle(&batch);
    let look = |_| {
        (0..LOOK).try_for_each(|_| left(solver.step(&mut batch, &torques)).map(drop))?;
        Ok(batch.states.clone())
    };
    (0..FRAMES / LOOK).map(look).collect()
}

/// Mean length of the way between configurations.
fn distance(system: &System, truth: &[Vec<f64>], states: &[Vec<f64>]) -> f64 {
    let (robot, d) = (&system.robot, system.robot.state_dim());
    let mut way = vec![0.0; robot.nv()];
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in truth.iter().zip(states).flat_map(|(a, b)| a.chunks_exact(d).zip(b.chunks_exact(d))) {
        difference(robot, &a[..robot.nq()], &b[..robot.nq()], &mut way);
        sum += way.iter().map(|x| x.abs()).sum::<f64>() / way.len() as f64;
        count += 1.0;
    }
    sum / count
}

impl Pace {
    /// Microseconds of a frame of one environment, among all of them.
    fn microseconds(&self) -> Option<f64> {
        self.frames[1].map(|frames| 1e6 / frames)
    }
}

pub(super) fn table(paces: &[Pace], asked: &Benchmark) -> Table {
    let cell = |x: Option<f64>| or_dash(x.map(digits));
    let lines = paces.iter().map(|p| {
        let [[on_cpu, on_card], [slow, fast]] = [p.errors, p.frames].map(|pair| pair.map(cell));
        let front = if p.front { "*" } else { "" }.into();
        vec![
            p.of.clone(),
            format!("{} {}", p.series, p.label),
            on_cpu,
            on_card,
            slow,
            fast,
            cell(p.microseconds()),
            p.lost.to_string(),
            front,
        ]
    });
    let note = format!(
        "No torques. Error: mean distance of configurations from `converged` over {FRAMES} frames, {} rollouts that begin {FALL} frames after a \
         start. Frames/s: {} environments together, on all cores of the CPU with 64 bits over {LOOK} frames, and on the card, which holds them for \
         {FRAMES} frames, with 32 bits; transfers are counted. Lost: environments that were given up. Front (*): no other setting is faster and \
         nearer.",
        asked.rollouts, asked.environments,
    );
    let header =
        ["robot, scene", "solver", "error, CPU (rad, m)", "error, card", "frames/s, CPU", "frames/s, card", "us a frame", "lost", "front"];
    Table::new("pace", &header).with(lines).noted(&note)
}

pub(super) fn figure(paces: &[Pace], of: &str, environments: usize) -> Figure {
    let marks = paces.iter().filter(|p| p.of == of).filter_map(|p| {
        // What has no error to draw, or one of a rollout that left, is in the table.
        let (cost, error) = (p.microseconds()?, p.errors[1].filter(|e| *e > 0.0 && *e < 10.0)?);
        Some(Mark { series: &p.series, cost, error, label: p.label.clone(), front: p.front })
    });
    let axes = [format!("microseconds a frame and environment, of {environments}"), format!("mean |dq| over {FRAMES} frames (rad or m)")];
    Figure::speed(format!("{of} on a GPU: speed against accuracy (x4: four substeps a frame)"), axes, marks, Vec::new())
}
