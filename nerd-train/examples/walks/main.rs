//! Throw-away: the articulated kernels in several variants on the GPU at hand, each timed and held against the first, which is the old text.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example walks
//! ```

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

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
const TEXTS: usize = 7;

fn text(v: &Variant, system: &System, config: &ArticulatedConfig, real: Real, reach: Reach) -> String {
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

/// Devices of all variants of several programs, made on all cores.
fn made(batch: &Batch, wanted: &[(ArticulatedConfig, Real)]) -> Outcome<Vec<Vec<Device>>> {
    let texts: Vec<Vec<String>> = wanted
        .iter()
        .map(|(config, real)| VARIANTS.iter().map(|v| text(v, &batch.system, config, *real, Reach::of(batch))).collect())
        .collect();
    std::thread::scope(|scope| {
        let threads: Vec<Vec<_>> = texts
            .iter()
            .map(|own| own[..TEXTS].iter().map(|text| scope.spawn(move || Device::open(0, text, &["advance"]))).collect())
            .collect();
        let mut all = Vec::new();
        for own in threads {
            let own: Result<Vec<Device>, _> = own.into_iter().map(|t| t.join().expect("a thread")).collect();
            all.push(own?);
        }
        Ok(all)
    })
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

fn main() -> Outcome<()> {
    let begun = Instant::now();
    for robot in ["anymal", "ant"] {
        let system: Arc<System> = System::named(robot)?;
        let width = system.robot.state_dim();
        let mut batch = Batch::new(&system, &system.scene("ground")?, 8192);
        (0..8192).for_each(|env| batch.reset(env, &start(&system, Start::Sample, &mut stream(3, env as u64))));
        let implicit = |n| ArticulatedConfig::implicit(n, Friction::Coulomb);
        let settings = [
            ("f64 implicit x8", implicit(8), Real::F64),
            ("implicit x4", implicit(4), Real::F32),
            ("implicit x1", implicit(1), Real::F32),
            ("implicit x8", implicit(8), Real::F32),
            ("implicit x16", implicit(16), Real::F32),
            ("Euler x16", ArticulatedConfig::explicit(16, Friction::Coulomb), Real::F32),
        ];
        let all = made(&batch, &settings.clone().map(|(_, config, real)| (config, real)))?;
        println!("{robot}: all compiled, {:.0} s after the beginning", begun.elapsed().as_secs_f64());
        // Until most of them touch something.
        batch.states = roll(&all[0][0], 32, &batch, &settings[0].1, 25, 1)?.0;
        for ((name, config, real), devices) in settings.iter().zip(&all) {
            let frames = if *real == Real::F64 { 20 } else { 100 };
            let first = [1, 10].map(|frames| roll(&devices[0], 32, &batch, config, frames, 1));
            let [one, ten] = first;
            let (one, ten) = (one?.0, ten?.0);
            let mut pace = 0.0;
            for (k, v) in VARIANTS.iter().enumerate() {
                let device = &devices[TEXT_OF[k]];
                let (_, seconds, lost) = roll(device, v.block, &batch, config, frames, 2)?;
                let (median, most, all) = apart(&roll(device, v.block, &batch, config, 1, 1)?.0, &one, width);
                let later = apart(&roll(device, v.block, &batch, config, 10, 1)?.0, &ten, width);
                let own = (8192 * frames) as f64 / seconds;
                pace = if v.old { own } else { pace };
                println!(
                    "{robot} {name}, {}: {own:.3e} frames/s, {:.2} times, {lost} lost; apart after a frame {median:.1e} (median), {most:.1e} (99 %), \
                     {all:.1e} (all); after ten {:.1e}, {:.1e}, {:.1e}",
                    v.name,
                    own / pace,
                    later.0,
                    later.1,
                    later.2
                );
            }
        }
        println!("{robot}: done {:.0} s after the beginning", begun.elapsed().as_secs_f64());
    }
    Ok(())
}
