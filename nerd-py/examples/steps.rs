//! Seconds of a frame and of a step of many Ants by a loop in Rust, for overhead.py to compare with: every line of
//! input is answered by both, of `steps CPU_OR_CUDA ENVIRONMENTS FRAMES`.

use std::io::BufRead;
use std::time::Instant;

use nerd_sim::prelude::*;
use nerd_train::ppo::Arena;

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

fn main() -> Outcome {
    let [device, n, frames] = &std::env::args().skip(1).collect::<Vec<_>>()[..] else { return Err("steps cpu|cuda N FRAMES".into()) };
    let (n, frames) = (n.parse()?, frames.parse()?);
    let [mut frame, mut step] = if device == "cuda" { on_card(n)? } else { on_cpu(n)? };
    for line in std::io::stdin().lock().lines() {
        line?;
        println!("{} {}", seconds(frames, &mut frame)?, seconds(frames, &mut step)?);
    }
    Ok(())
}

/// A frame or a step; asked whether it is the last one, after which all is to be done.
type Once = Box<dyn FnMut(bool) -> Outcome>;

fn seconds(times: usize, once: &mut Once) -> Outcome<f64> {
    let started = Instant::now();
    (1..=times).try_for_each(|k| once(k == times))?;
    Ok(started.elapsed().as_secs_f64() / times as f64)
}

fn ants(n: usize, solver: impl FnOnce(&Arc<System>) -> Outcome<Box<dyn Solver>>) -> Outcome<Simulation> {
    let system = System::named("ant")?;
    let mut batch = Batch::new(&system, &system.scene("ground")?, n);
    for env in 0..n {
        let state = start(&system, Start::Reset, &mut stream(0, (env as u64) << 32));
        batch.state_mut(env).copy_from_slice(&state);
    }
    Ok(Simulation::new(batch, solver(&system)?))
}

fn on_cpu(n: usize) -> Outcome<[Once; 2]> {
    let mut simulation = ants(n, |system| Ok(Truth::Articulated.solver(system)))?;
    let mut episodes = Arena::Truth(Truth::Articulated).episodes("ant-run", n, 0)?;
    let (torques, actions) = (vec![0.0; n * 8], vec![0.0; n * 8]);
    Ok([Box::new(move |_| Ok(simulation.step(&torques)?)), Box::new(move |_| Ok(episodes.step(&actions).map(drop)?))])
}

#[cfg(not(feature = "cuda"))]
fn on_card(_: usize) -> Outcome<[Once; 2]> {
    Err("this needs a build with `--features cuda`".into())
}

#[cfg(feature = "cuda")]
fn on_card(n: usize) -> Outcome<[Once; 2]> {
    use nerd_sim::articulated::device::{Real, SharedStates};
    use nerd_train::ppo::CudaEpisodes;
    use nerd_train::{device::resident, learner::cuda::Precision, nerd_model::pick::Setting};

    let mut simulation = ants(n, |system| Ok(resident(&Setting::Accurate, system, Real::F32, Precision::F16)?))?;
    let mut states = SharedStates::new(&mut simulation)?;
    let mut episodes = CudaEpisodes::new(Arena::Card(Setting::Accurate).episodes("ant-run", n, 0)?)?;
    let (device, actions) = (nerd_cuda::Device::open("", &[])?, episodes.upload(&vec![0.0; n * 8])?);
    let torques = device.upload(&vec![0.0; n * 8])?;
    let frame = move |last: bool| -> Outcome {
        states.step(&mut simulation, torques.ptr)?;
        if last {
            states.beside().wait()?
        }
        Ok(())
    };
    let step = move |last: bool| -> Outcome {
        episodes.step(actions.ptr)?;
        if last {
            episodes.beside().wait()?
        }
        Ok(())
    };
    Ok([Box::new(frame), Box::new(step)])
}
