//! Seconds of a frame and of a step of many Ants on the CPU, of a step on a card, by a loop in Rust for overhead.py and loop_card.py to
//! compare with: every line of input is answered, of `steps CPU_OR_CUDA ENVIRONMENTS FRAMES`.

use std::io::BufRead;
use std::time::Instant;

use nerd_sim::prelude::*;
use nerd_train::ppo::Arena;

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

fn main() -> Outcome {
    let [device, n, frames] = &std::env::args().skip(1).collect::<Vec<_>>()[..] else { return Err("steps cpu|cuda N FRAMES".into()) };
    let (n, frames) = (n.parse()?, frames.parse()?);
    let mut all = if device == "cuda" { on_card(n)? } else { on_cpu(n)? };
    for line in std::io::stdin().lock().lines() {
        line?;
        let found = all.iter_mut().map(|once| Ok(seconds(frames, once)?.to_string())).collect::<Outcome<Vec<_>>>()?;
        println!("{}", found.join(" "));
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

fn on_cpu(n: usize) -> Outcome<Vec<Once>> {
    let system = System::named("ant")?;
    let mut batch = Batch::new(&system, &system.scene("ground")?, n);
    for env in 0..n {
        batch.reset(env, &start(&system, Start::Reset, &mut stream(0, (env as u64) << 32)));
    }
    let mut simulation = Simulation { batch, solver: Truth::Articulated.solver(&system) };
    let mut episodes = Arena::Truth(Truth::Articulated).episodes("ant-run", n, 0)?;
    let (torques, actions) = (vec![0.0; n * 8], vec![0.0; n * 8]);
    Ok(vec![Box::new(move |_| Ok(simulation.step(&torques)?)), Box::new(move |_| Ok(episodes.step(&actions).map(drop)?))])
}

#[cfg(not(feature = "cuda"))]
fn on_card(_: usize) -> Outcome<Vec<Once>> {
    Err("this needs a build with `--features cuda`".into())
}

#[cfg(feature = "cuda")]
fn on_card(n: usize) -> Outcome<Vec<Once>> {
    use nerd_train::nerd_model::pick::Setting;
    use nerd_train::ppo::CudaEpisodes;

    let mut episodes = CudaEpisodes::new(Arena::Card(Setting::Accurate).episodes("ant-run", n, 0)?)?;
    let actions = episodes.upload(&vec![0.0; n * 8])?;
    let step = move |last: bool| -> Outcome {
        episodes.step(actions.ptr)?;
        if last {
            episodes.beside().wait()?
        }
        Ok(())
    };
    Ok(vec![Box::new(step)])
}
