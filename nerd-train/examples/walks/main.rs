//! Throw-away: the articulated kernels in several variants on the GPU at hand, each timed and held against the first, which is the old text.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example walks
//! ```
//!
//! It ends after 75 s wherever it is. With a folder as its argument it writes the texts there and ends. Implicit texts take the number of
//! substeps when they run, so that one is compiled for all.

use std::collections::{HashMap, VecDeque};
use std::error::Error;
use std::path::Path;
use std::sync::{Arc, Mutex, mpsc};
use std::time::{Duration, Instant};

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::Device;
use nerd_sim::articulated::device::{Reach, Real, program, record};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};

type Outcome<T> = Result<T, Box<dyn Error>>;

macro_rules! old {
    ($($name:literal),*) => {
        [$((include_str!(concat!("../../../nerd-sim/src/articulated/device/", $name)), include_str!(concat!("old/", $name)))),*]
    };
}

/// What a variant's text changes, and environments of a block.
struct Variant {
    name: &'static str,
    old: bool,
    unrolled: bool,
    gathered: bool,
    quick: bool,
    linked: bool,
    block: usize,
}

const fn variant(name: &'static str, flags: [bool; 5], block: usize) -> Variant {
    let [old, unrolled, gathered, quick, linked] = flags;
    Variant { name, old, unrolled, gathered, quick, linked, block }
}

const VARIANTS: [Variant; 12] = [
    variant("0 old text", [true, false, false, false, false], 32),
    variant("1 new text, all in loops", [false, false, false, false, false], 32),
    variant("2 unrolled, matrix of touches in memory", [false, true, false, false, true], 32),
    variant("3 unrolled, in registers by link", [false, true, true, false, true], 32),
    variant("4 as 3, rsqrt", [false, true, true, true, true], 32),
    variant("5 as 2, kinematics and bias in loops", [false, true, false, false, false], 32),
    variant("6 as 3, kinematics and bias in loops", [false, true, true, false, false], 32),
    variant("7 as 3, blocks of 16", [false, true, true, false, true], 16),
    variant("8 as 3, blocks of 8", [false, true, true, false, true], 8),
    variant("9 as 3, blocks of 64", [false, true, true, false, true], 64),
    variant("A as 5, blocks of 16", [false, true, false, false, false], 16),
    variant("B as 5, blocks of 64", [false, true, false, false, false], 64),
];

/// The first variant with the same text.
const TEXT_OF: [usize; 12] = [0, 1, 2, 3, 4, 5, 6, 3, 3, 3, 5, 5];
/// In what order they are made and timed.
const TEXTS: [usize; 7] = [0, 3, 5, 2, 6, 4, 1];
const ORDER: [usize; 12] = [0, 3, 5, 2, 6, 4, 7, 8, 9, 10, 11, 1];
const LIMIT: Duration = Duration::from_secs(75);

/// What texts are made of: robot, explicit or implicit, precision.
const PROGRAMS: [(&str, bool, Real); 5] = [
    ("anymal", true, Real::F32),
    ("ant", true, Real::F32),
    ("anymal", false, Real::F32),
    ("ant", false, Real::F32),
    ("anymal", true, Real::F64),
];

/// What is timed: one of the programs, substeps.
const SETTINGS: [(usize, usize); 11] = [(0, 4), (0, 8), (0, 16), (1, 4), (1, 16), (2, 16), (3, 16), (4, 8), (0, 1), (1, 8), (1, 1)];

/// Sets the number of substeps.
const PACE: &str = "extern \"C\" __global__ void pace(int n) { PACE = n; }\n";

/// With substeps as a number of the device.
fn text(v: &Variant, system: &System, config: &ArticulatedConfig, real: Real, reach: Reach) -> String {
    let text = fixed(v, system, config, real, reach);
    if config.contact_step != ContactStep::Implicit {
        return text + "extern \"C\" __global__ void pace(int n) {}\n";
    }
    let own = |name: &str, n: usize| format!("#define {name} {n}\n");
    let (one, other) = (own("SUBSTEPS", config.substeps), own("CONTACT_SUBSTEPS", config.contact_substeps));
    assert!(text.contains(&one) && text.contains(&other));
    let text = text.replace(&one, "#define SUBSTEPS PACE\n").replace(&other, "#define CONTACT_SUBSTEPS PACE\n");
    format!("static __device__ int PACE = 1;\n{text}{PACE}")
}

fn fixed(v: &Variant, system: &System, config: &ArticulatedConfig, real: Real, reach: Reach) -> String {
    let mut text = program(system, config, real, reach);
    if v.old {
        for (new, old) in
            old!["linear.cuh", "surface.cuh", "tree.cuh", "along.cuh", "touch.cuh", "implicit.cuh", "explicit.cuh", "frame.cuh"]
        {
            assert!(text.contains(new));
            text = text.replace(new, old);
        }
        text = text.replace(include_str!("../../../nerd-sim/src/articulated/device/walk.cuh"), "");
        return format!("#define DEPTH NV\n{text}");
    }
    let mut set = |name: &str, on: bool| {
        for known in [0, 1] {
            text = text.replace(&format!("#define {name} {known}\n"), &format!("#define {name} {}\n", i32::from(on)));
        }
    };
    set("UNROLLED", v.unrolled);
    set("GATHERED", v.gathered);
    set("QUICK", v.quick);
    text.replace("#define LINKED UNROLLED\n", &format!("#define LINKED {}\n", i32::from(v.linked)))
}

/// Final states, the best seconds of some rolls, environments given up.
fn roll(
    device: &Device,
    block: usize,
    batch: &Batch,
    config: &ArticulatedConfig,
    frames: usize,
    times: usize,
) -> Outcome<(Vec<f64>, f64, usize)> {
    let (system, n, reach) = (&batch.system, batch.len(), Reach::of(batch));
    let records = device.upload(&record(&batch.scenes[0], system, config, reach)?)?;
    let (states, torques) = (device.upload(&batch.states)?, device.zeros::<f64>(n * system.robot.joint_count())?);
    let (of, drives, faults, done) = (device.zeros::<i32>(n)?, device.zeros::<f64>(1)?, device.zeros::<i32>(n)?, device.zeros::<u32>(n)?);
    device.launch("pace", (1, 1), (1, 1), 0, &[Int(config.substeps)])?;
    let mut best = f64::INFINITY;
    for _ in 0..times {
        device.write(&states, &batch.states)?;
        let args = [states.ptr, torques.ptr, records.ptr, of.ptr, drives.ptr, 0, faults.ptr, done.ptr].map(Ptr);
        let args = [&args[..], &[n, frames, 1].map(Int)].concat();
        device.wait()?;
        let begun = Instant::now();
        device.launch("advance", (n.div_ceil(block), 1), (block, 1), 0, &args)?;
        device.wait()?;
        best = best.min(begun.elapsed().as_secs_f64());
    }
    let (mut last, mut wrong) = (vec![0.0; batch.states.len()], vec![0i32; n]);
    device.read(&states, &mut last)?;
    device.read(&faults, &mut wrong)?;
    Ok((last, best, wrong.iter().filter(|f| **f != 0).count()))
}

fn apart(a: &[f64], b: &[f64], width: usize) -> (f64, f64, f64) {
    let one = |(a, b): (&[f64], &[f64])| a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max);
    let mut all: Vec<f64> = a.chunks(width).zip(b.chunks(width)).map(one).collect();
    all.sort_by(f64::total_cmp);
    (all[all.len() / 2], all[all.len() * 99 / 100], all[all.len() - 1])
}

/// Devices as they are made, by program and variant; each with how long that took beside the others.
type Made = Result<(Device, f64), String>;
struct Devices {
    coming: mpsc::Receiver<((usize, usize), Made)>,
    here: HashMap<(usize, usize), Made>,
}

impl Devices {
    /// Makes them on all cores, in order.
    fn of(texts: Vec<((usize, usize), String)>) -> Self {
        let (queue, (send, coming)) = (Arc::new(Mutex::new(VecDeque::from(texts))), mpsc::channel());
        for _ in 0..std::thread::available_parallelism().map_or(1, |n| n.get().saturating_sub(1).clamp(1, 14)) {
            let (queue, send) = (queue.clone(), send.clone());
            std::thread::spawn(move || {
                loop {
                    let next = queue.lock().expect("a queue").pop_front();
                    let Some((key, text)) = next else { break };
                    let begun = Instant::now();
                    let made = Device::open(0, &text, &["advance", "pace"]).map_err(|e| e.to_string());
                    let _ = send.send((key, made.map(|device| (device, begun.elapsed().as_secs_f64()))));
                }
            });
        }
        Self { coming, here: HashMap::new() }
    }

    fn get(&mut self, key: (usize, usize)) -> Result<&Device, String> {
        while !self.here.contains_key(&key) {
            let (key, made) = self.coming.recv().map_err(|e| e.to_string())?;
            let said = made.as_ref().map_or_else(|e| e[..e.len().min(600)].to_string(), |(_, seconds)| format!("{seconds:.1} s"));
            println!("made {:?} text {}: {said}", PROGRAMS[key.0], VARIANTS[key.1].name);
            self.here.insert(key, made);
        }
        self.here[&key].as_ref().map(|(device, _)| device).map_err(|_| "not made".into())
    }
}

fn config(implicit: bool, substeps: usize) -> ArticulatedConfig {
    if implicit {
        ArticulatedConfig::implicit(substeps, Friction::Coulomb)
    } else {
        ArticulatedConfig::explicit(substeps, Friction::Coulomb)
    }
}

fn batch(robot: &str, n: usize) -> Outcome<Batch> {
    let system: Arc<System> = System::named(robot)?;
    let mut batch = Batch::new(&system, &system.scene("ground")?, n);
    (0..n).for_each(|env| batch.reset(env, &start(&system, Start::Sample, &mut stream(3, env as u64))));
    Ok(batch)
}

/// One line; what the old text made of one and of ten frames, and its pace, are kept in `old`.
fn line(
    device: &Device,
    v: &Variant,
    name: &str,
    batch: &Batch,
    config: &ArticulatedConfig,
    frames: usize,
    old: &mut Vec<Vec<f64>>,
) -> Outcome<()> {
    let width = batch.system.robot.state_dim();
    let (_, seconds, lost) = roll(device, v.block, batch, config, frames, 2)?;
    let own = (batch.len() * frames) as f64 / seconds;
    let (one, ten) = (roll(device, v.block, batch, config, 1, 1)?.0, roll(device, v.block, batch, config, 10, 1)?.0);
    if v.old {
        *old = vec![one.clone(), ten.clone(), vec![own]];
    }
    let ((a, b, c), (d, e, f)) = (apart(&one, &old[0], width), apart(&ten, &old[1], width));
    println!(
        "{name}, {}: {own:.3e} frames/s, {:.2} times, {lost} lost; apart after a frame {a:.1e} (median), {b:.1e} (99 %), {c:.1e} (all); after \
         ten {d:.1e}, {e:.1e}, {f:.1e}",
        v.name,
        own / old[2][0]
    );
    Ok(())
}

fn main() -> Outcome<()> {
    let begun = Instant::now();
    std::thread::spawn(|| {
        std::thread::sleep(LIMIT);
        println!("ended after {LIMIT:?}");
        std::process::exit(0);
    });
    let mut texts = Vec::new();
    for (p, (robot, implicit, real)) in PROGRAMS.iter().enumerate() {
        let (batch, config) = (batch(robot, 1)?, config(*implicit, 16));
        texts.extend(TEXTS.map(|k| ((p, k), text(&VARIANTS[k], &batch.system, &config, *real, Reach::of(&batch)))));
    }
    if let Some(folder) = std::env::args().nth(1) {
        for ((p, k), text) in texts {
            let (robot, implicit, real) = PROGRAMS[p];
            std::fs::write(Path::new(&folder).join(format!("{robot}-{implicit}-{real:?}-{k}.cu")), text)?;
        }
        return Ok(());
    }
    let mut devices = Devices::of(texts);
    let mut batches = HashMap::new();
    for (p, substeps) in SETTINGS {
        let (robot, implicit, real) = PROGRAMS[p];
        if !batches.contains_key(robot) {
            let mut batch = batch(robot, 8192)?;
            // Until most of them touch something.
            batch.states = roll(devices.get((p, 0))?, 32, &batch, &config(true, 8), 25, 1)?.0;
            batches.insert(robot, batch);
        }
        let (batch, config) = (&batches[robot], config(implicit, substeps));
        let frames = if real == Real::F64 { 16 } else { (400 / substeps).min(100) };
        let name = format!("{robot} {} x{substeps} {real:?}", if implicit { "implicit" } else { "Euler" });
        let mut old = Vec::new();
        for k in ORDER {
            match devices.get((p, TEXT_OF[k])) {
                Ok(device) => line(device, &VARIANTS[k], &name, batch, &config, frames, &mut old)?,
                Err(e) => println!("{name}, {}: {e}", VARIANTS[k].name),
            }
        }
        println!("{name}: done {:.0} s after the beginning", begun.elapsed().as_secs_f64());
    }
    // Some may still be making devices.
    std::process::exit(0);
}
