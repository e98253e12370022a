//! Command lines of the verbs, each run as its users would, in a folder of its own that has `f/` with good files, a file
//! `there`, and a link `null` to /dev/null.

use rand::{Rng, RngExt};

use crate::campaign::case::Files;
use crate::campaign::mutate::{one, times};

mod good;
mod judge;

pub use judge::judge;

const FILE: &str = "line.txt";

/// What is always said, and what may be said beside it. Small: each is to end within a second.
const VERBS: [(&str, &str); 9] = [
    ("dataset --robot pendulum --transitions 40 --frames 4 --out out", "--torque-scale 0.5 --hold 2 --resets 0.5 --seed 3 --truth rapier"),
    ("inspect f/data --out out", "--robot pendulum --bound 100"),
    (
        "rollout --robot pendulum --states f/states.csv --frames 3 --out out/r.csv",
        "--scene ground1 --solver rapier --substeps 2 --preset converged --friction huber --truth rapier --model f/model --tolerance 0.1 \
         --device cpu",
    ),
    (
        "rollout --robot f/robot.urdf --states f/robot.csv --frames 3 --out out/r.csv",
        "--scene plane --solver neural --substeps 2 --preset converged --friction huber --truth rapier --model f/model",
    ),
    (
        "evaluate --robot pendulum --scene ground1 --starts 2 --frames 3",
        "--solver neural --model f/model --seed 3 --shake 0.1 --drive 0.5 --limp --truth rapier --substeps 4 --preset converged \
         --friction huber --tolerance 0.1 --out out",
    ),
    (
        "train --robot pendulum --recipe small --embedding 8 --layers 1 --history 4 --transitions 200 --frames 20 --updates 2 --batch 4 \
         --rollouts 1 --minutes 0.02 --out out",
        "--stream --sequence 6 --base flight --variant absolute --rate 1e-3 --last-rate 1e-4 --tail 0.3 --warmup 1 --optimizer muon \
         --huber 1 --average 0.9 --validate-every 1 --torque-scale 0.5 --hold 2 --resets 0.5 --fresh 20 --seed 3 --finish --data f/data \
         --from f/model --policy-share 0.5 --policy f/policy --truth rapier --f32",
    ),
    (
        "policy train cartpole-swingup --envs 4 --horizon 4 --iterations 1 --minibatch 8 --minutes 0.02 --out out",
        "--solver rapier --until 1 --seed 3 --recipe small --model f/model --device cuda",
    ),
    ("policy evaluate --policy f/policy --games 2 --truth-only", "--seed 3 --model f/model --device cpu --out out"),
    ("urdf f/robot.urdf", "--out out"),
];

/// Values that no option wants. None names a place outside the case's folder; `''` is an empty word.
const ODD: &str = "nan inf -inf 1e308 -1e308 1e-308 -0 0 -1 0.5 2 3 7 -0.5 18446744073709551615 18446744073709551616 \
                   9223372036854775807 1000000000000 '' x . f there null f/absent f/states.csv ü 1,2 pendulum cartpole";

/// A command line, changed.
pub fn make(rng: &mut impl Rng) -> Files {
    let (always, beside) = one(rng, &VERBS);
    let mut words = options(always);
    let share = rng.random::<f64>();
    words.extend(options(beside).into_iter().filter(|_| rng.random::<f64>() < 0.4 * share));
    for _ in 0..times(rng) {
        let at = rng.random_range(0..words.len());
        let (verb, value) = (!words[at].starts_with("--"), words[at].split_once(' ').map(|(flag, _)| flag.to_string()));
        match (rng.random_range(0..10), value) {
            (0..6, Some(flag)) if !verb => words[at] = format!("{flag} {}", odd(rng, &flag)),
            (6, Some(flag)) if !verb => words.push(format!("{flag} {}", odd(rng, &flag))),
            (7, _) => {
                // Somebody else's option.
                let foreign = options(one(rng, &VERBS).1);
                let option = &foreign[rng.random_range(0..foreign.len())];
                words.extend(Some(option.clone()).filter(|o| !o.starts_with("--out")));
            }
            (8, Some(flag)) if flag == "--out" || flag == "--seed" => drop(words.remove(at)),
            (9, _) => words.push(one(rng, &["--nonsense", "-x", "extra", "--", "--help", "''"]).into()),
            _ => {}
        }
    }
    Files::from([(FILE.into(), words.join(" ").into_bytes())])
}

/// The verb, then each option with its value.
fn options(line: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for word in line.split_whitespace() {
        match found.last_mut() {
            Some(last) if !word.starts_with("--") => {
                last.push(' ');
                last.push_str(word);
            }
            _ => found.push(word.into()),
        }
    }
    found
}

fn odd(rng: &mut impl Rng, flag: &str) -> &'static str {
    let words = match flag {
        // An output may stand in its own folder only, and not in that of the good files.
        "--out" => "'' out/a/b/c there null there/a .",
        // The recipe of a shipped model is honest work of minutes.
        "--recipe" => "'' x 0 nan small converged",
        "--preset" => "'' x 0 nan paper accurate",
        _ => ODD,
    };
    one(rng, &words.split(' ').collect::<Vec<_>>())
}
