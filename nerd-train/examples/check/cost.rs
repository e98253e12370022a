//! What a frame costs on the card with its vector-Jacobian product by state and torque, beside the frame alone, in time and memory. Robots of one's own,
//! named by their paths among the parts, `check slopes-cost robot.urdf`, come in the built-in ones' place, driven by a tenth of its torques: at full strength random torques throw some
//! light legs of a Go2 so fast that their frames have no slopes on a card.

use nerd_sim::articulated::device::{Back, Trail};

use crate::solvers::batch;
use crate::with::*;

/// Environments, frames that are timed, frames before them, in which robots fall.
const N: usize = 4096;
const FRAMES: usize = 30;
const BEFORE: usize = 30;
/// A frame with its product, in frames, at most.
const MOST: f64 = 3.0;

pub fn cost(checks: &mut Checks) -> Outcome {
    let own: Vec<String> = std::env::args().skip(1).filter(|name| name.contains('.')).collect();
    for path in &own {
        articulated(checks, path, &System::named(path)?, 0.1)?;
    }
    let built_in: &[&str] = if own.is_empty() { &["cartpole", "ant", "anymal"] } else { &[] };
    for robot in built_in {
        let system = System::named(robot)?;
        articulated(checks, robot, &system, 1.0)?;
        let folder = Path::new("models").join(robot);
        let solver = |device: Device| device.neural(&folder, &system, None, N);
        beside(checks, &format!("{robot}, its network"), &system, 1.0, [&mut *solver(Device::Cuda)?, &mut *solver(Device::Cpu)?])?;
    }
    Ok(())
}

fn articulated(checks: &mut Checks, name: &str, system: &Arc<System>, strength: f64) -> Outcome {
    let config = Setting::Implicit(4).articulated(system).ok_or("no settings")?;
    let (mut card, mut cpu) = (CudaArticulated::new(config, Real::F32), Articulated::new(config));
    beside(checks, &format!("{name}, articulated x4"), system, strength, [&mut card, &mut cpu])
}

/// Random torques of a frame, and a batch that they have driven for a while.
fn driven(system: &Arc<System>, strength: f64, frame: u64) -> Vec<f64> {
    let amplitudes = system.torque_amplitudes();
    numbers(10 + frame, N * amplitudes.len())
        .into_iter()
        .zip(amplitudes.iter().cycle())
        .map(|(x, most)| strength * f64::from(x) * most)
        .collect()
}

fn begun(system: &Arc<System>, strength: f64, solver: &mut dyn Solver) -> Outcome<Batch> {
    let mut batch = batch(system, N)?;
    (0..BEFORE).try_for_each(|frame| solver.step(&mut batch, &driven(system, strength, frame as u64)))?;
    Ok(batch)
}

/// In one solver: the same frames alone and with their products, all of them on the card.
fn beside(checks: &mut Checks, name: &str, system: &Arc<System>, strength: f64, [solver, truth]: [&mut dyn Solver; 2]) -> Outcome {
    let (batch, torques) = (begun(system, strength, solver)?, driven(system, strength, 100));
    let by: Vec<f64> = numbers(4, N * 2 * system.robot.nv()).into_iter().map(f64::from).collect();
    let frames = used(solver)?;
    // Once for the kernels; and what is timed is what it should be.
    let [there, here] = [solver.back(&batch, &torques, 1, &by)?.states, truth.back(&batch, &torques, 1, &by)?.states];
    let mut off: Vec<f64> = there.chunks(by.len() / N).zip(here.chunks(by.len() / N)).map(|(a, b)| largest(a, b)).collect();
    off.sort_by(f64::total_cmp);
    let what = format!("{name}: slopes {:.1e} from the CPU's in the median, {:.1e} in nine of ten", off[N / 2], off[N / 10 * 9]);
    checks.demand(off[N / 2] < 1e-3, what);
    println!("   {name}: {frames} MiB of the card are in use for frames, {} MiB with products", used(solver)?);
    let resident = solver.resident().ok_or("it is not on the card")?;
    let mut pass = |back: bool| -> Outcome<f64> {
        resident.hold(&batch)?;
        resident.keep(&batch, 1)?;
        let (card, held) = resident.held().ok_or("nothing is held")?;
        let (by_next, faults) = (card.upload(&by)?, card.zeros::<i32>(N)?);
        let found = (card.zeros::<f64>(batch.states.len())?, card.zeros::<f64>(by.len())?, card.zeros::<f64>(torques.len())?);
        card.write(&held.torques, &torques)?;
        let trail = Trail { states: held.states.ptr, torques: held.torques.ptr, frames: 1 };
        let next = [found.0.ptr, faults.ptr];
        let way = Back { frame: 0, rows: 1, by_next: by_next.ptr, by_states: found.1.ptr, by_torques: found.2.ptr, next };
        let started = Instant::now();
        for _ in 0..FRAMES {
            if back {
                resident.recall(trail)?;
                resident.back(trail, way)?;
            }
            resident.frame()?;
        }
        card.wait()?;
        Ok(started.elapsed().as_secs_f64() / FRAMES as f64)
    };
    pass(true)?;
    let (alone, both) = (pass(false)?, pass(true)?);
    let pace = |seconds: f64| N as f64 / seconds * 1e-6;
    let (with, slow, quick) = (both - alone, pace(both - alone), pace(alone));
    let (ratio, [alone, with]) = (with / alone, [alone, with].map(|s| 1e6 * s));
    let what = format!("{name}: {quick:.3} M frames/s, {slow:.3} M with products, {ratio:.2} times the time ({alone:.0} and {with:.0} us)");
    checks.demand(ratio <= MOST, what);
    Ok(())
}

/// MiB of the card's memory that are in use.
fn used(solver: &mut dyn Solver) -> Outcome<usize> {
    let held = solver.resident().and_then(|resident| Some(resident.held()?.0.used()));
    Ok(held.transpose()?.unwrap_or_default() >> 20)
}
