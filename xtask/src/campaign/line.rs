//! Command lines of the verbs, each run as its users would, in a folder of its own that has `f/` with good files, a file
//! `there`, and a link `null` to /dev/null.

use std::fs::File;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use rand::{Rng, RngExt};

use super::bench::{Bench, write};
use super::case::{Fault, Files, Verdict, text};
use super::child::{End, SECONDS, wait};
use super::files::{NOT_FINITE, below, whole};
use super::mutate::{one, times};
use super::robots::ROBOTS;

const FILE: &str = "line.txt";

/// Longest refusal (bytes): somebody is to read it.
const WORDS: usize = 10_000;

/// What is always said, and what may be said beside it. Small: each is to end within a second.
const VERBS: [(&str, &str); 9] = [
    ("dataset --robot pendulum --transitions 40 --frames 4 --out out", "--torque-scale 0.5 --hold 2 --resets 0.5 --seed 3 --truth rapier"),
    ("inspect f/data --out out", "--robot pendulum --bound 100"),
    (
        "rollout --robot pendulum --states f/states.csv --steps 3 --out out/r.csv",
        "--scene ground1 --solver rapier --substeps 2 --preset converged --friction huber --truth rapier --model f/model --tolerance 0.1 \
         --device flex",
    ),
    (
        "rollout --robot f/robot.urdf --states f/robot.csv --steps 3 --out out/r.csv",
        "--scene plane --solver neural --substeps 2 --preset converged --friction huber --truth rapier --model f/model",
    ),
    (
        "evaluate --robot pendulum --scene ground1 --starts 2 --steps 3",
        "--solver neural --model f/model --seed 3 --shake 0.1 --drive 0.5 --limp --truth rapier --substeps 4 --preset converged \
         --friction huber --tolerance 0.1 --out out/e.json",
    ),
    (
        "train --robot pendulum --preset small --embedding 8 --layers 1 --history 4 --transitions 200 --frames 20 --updates 2 --batch 4 \
         --rollouts 1 --minutes 0.02 --out out",
        "--stream --sequence 6 --base flight --variant absolute --rate 1e-3 --last-rate 1e-4 --tail 0.3 --warmup 1 --optimizer muon \
         --huber 1 --average 0.9 --validate-every 1 --torque-scale 0.5 --hold 2 --resets 0.5 --fresh 20 --seed 3 --finish --data f/data \
         --from f/model --policy-share 0.5 --policy f/policy --truth rapier --f32",
    ),
    (
        "policy train cartpole-swingup --envs 4 --horizon 4 --iterations 1 --minibatch 8 --minutes 0.02 --out out",
        "--solver rapier --until 1 --seed 3 --preset small --model f/model --device cuda",
    ),
    (
        "policy evaluate cartpole-swingup --policy f/policy --games 2 --truth-only",
        "--seed 3 --model f/model --device flex --out out/p.json",
    ),
    ("urdf f/robot.urdf", "--out out/u.md"),
];

/// Values that no option wants. None names a place outside the case's folder.
const ODD: [&str; 30] = [
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-308",
    "-0",
    "0",
    "-1",
    "0.5",
    "2",
    "3",
    "7",
    "-0.5",
    "18446744073709551615",
    "18446744073709551616",
    "9223372036854775807",
    "1000000000000",
    "''",
    "x",
    ".",
    "f",
    "there",
    "null",
    "f/absent",
    "f/states.csv",
    "ü",
    "1,2",
    "pendulum",
    "cartpole",
];

/// A command line, changed.
pub fn make(rng: &mut impl Rng) -> Files {
    let (always, beside) = VERBS[rng.random_range(0..VERBS.len())];
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
                let foreign = options(VERBS[rng.random_range(0..VERBS.len())].1);
                let option = foreign[rng.random_range(0..foreign.len())].clone();
                words.extend(Some(option).filter(|o| !o.starts_with("--out")));
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
    // An output may stand in its own folder only, and not in that of the good files.
    if flag == "--out" { one(rng, &["''", "out/a/b/c", "there", "null", "there/a", "."]) } else { one(rng, &ODD) }
}

/// Runs it. Of several lines the last is judged; those before it prepare, with `rm FILE` and `cut FILE` among them, which takes
/// a file's second half away.
pub fn judge(files: &Files, bench: &Bench) -> Result<Verdict> {
    let Some(text) = text(files, FILE) else { return Ok(Verdict::Refused("not UTF-8".into())) };
    let good = bench.path("good");
    if !good.exists() {
        fixtures(bench, &good)?;
    }
    let folder = bench.empty("line")?;
    std::fs::write(folder.join("there"), "x")?;
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&good, folder.join("f"))?;
        std::os::unix::fs::symlink("/dev/null", folder.join("null"))?;
    }
    let said = bench.path("said.txt");
    let (before, line) = text.trim().rsplit_once('\n').unwrap_or(("", text));
    before.lines().try_for_each(|line| prepare(line, &folder, &said))?;
    let had = below(&folder)?;
    let end = run(line, &folder, &said)?;
    let words = String::from_utf8_lossy(&std::fs::read(&said)?).trim().to_string();
    let panic = words.lines().skip_while(|line| !line.contains("panicked at")).take(2).collect::<Vec<_>>().join(" ");
    let last = words.lines().last().unwrap_or_default().to_string();
    let fault = |what, words: &str| Ok(Verdict::Fault(what, words.into()));
    let left: Vec<_> = below(&folder)?.into_iter().filter(|p| !had.contains(p)).collect();
    let kept = std::fs::read(folder.join("there"))? == b"x" && folder.join("null").is_symlink();
    match end {
        End::Late => fault(Fault::Time, &last),
        End::Signal if words.contains("memory allocation of") => fault(Fault::Memory, &last),
        End::Signal => fault(Fault::Abort, &last),
        _ if !panic.is_empty() => fault(Fault::Panic, &panic),
        End::Code(0) => Ok(left.iter().find_map(|p| whole(p).err()).map_or(Verdict::Accepted, |words| {
            let fault = if words.contains(NOT_FINITE) { Fault::NotFinite } else { Fault::Untidy };
            Verdict::Fault(fault, words)
        })),
        End::Code(2) if last.len() > WORDS => fault(Fault::Untidy, &format!("a refusal of {} bytes", last.len())),
        End::Code(2) if last.is_empty() => fault(Fault::Untidy, "a refusal without a word"),
        End::Code(2) if !left.is_empty() || before.is_empty() && folder.join("out").exists() => {
            fault(Fault::Untidy, &format!("a refusal left {left:?}: {last}"))
        }
        End::Code(2) if !kept => fault(Fault::Untidy, &format!("a refusal replaced a file: {last}")),
        End::Code(2) => Ok(Verdict::Refused(last)),
        End::Code(code) => fault(Fault::Abort, &format!("exit code {code}: {last}")),
    }
}

fn prepare(line: &str, folder: &Path, said: &Path) -> Result<()> {
    match line.split_once(' ') {
        Some(("rm", file)) => std::fs::remove_file(folder.join(file)).with_context(|| line.to_string()),
        Some(("cut", file)) => {
            let path = folder.join(file);
            let bytes = std::fs::read(&path).with_context(|| line.to_string())?;
            Ok(std::fs::write(path, &bytes[..bytes.len() / 2])?)
        }
        _ => {
            let end = run(line, folder, said)?;
            ensure!(end == End::Code(0), "`{line}` failed: {}", std::fs::read_to_string(said)?);
            Ok(())
        }
    }
}

/// Runs a line in a folder, what it says going to a file.
fn run(line: &str, folder: &Path, said: &Path) -> Result<End> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(line.split_whitespace().map(|w| if w == "''" { "" } else { w })).current_dir(folder);
    // Its results are thrown away, so nobody needs to ask git where they come from.
    command.envs([("NERD_COMMIT", "campaign"), ("RAYON_NUM_THREADS", "1"), ("RUST_BACKTRACE", "0")]);
    wait(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(File::create(said)?).spawn()?, SECONDS)
}

/// The good files: a robot with a specification, states, a model, a data set, a policy.
fn fixtures(bench: &Bench, folder: &Path) -> Result<()> {
    let file = |folder: &'static str, name: &str, text: &str| (folder, name.to_string(), text.as_bytes().to_vec());
    let (xml, spec) = (include_str!("../../tests/corpus/toml/robot.urdf"), include_str!("../../tests/corpus/toml/robot.toml"));
    let half = bench.path("half");
    // The same names, other physics.
    let [_, (_, pendulum, urdf), ..] = ROBOTS;
    let files = [
        file("", "robot.urdf", xml),
        file("", "robot.toml", spec),
        file("", "states.csv", "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n1,0,-1,0.5,0,1\n"),
        file("", "robot.csv", "traj,step,arm,d_arm\n0,0,0.1,0.2\n"),
        file("other", "robot.urdf", &xml.replace("mass value=\"1\"", "mass value=\"2\"")),
        file("other", "robot.toml", spec),
        file("other", "pendulum.urdf", &urdf.replace("mass value=\"25", "mass value=\"2")),
        file("other", "pendulum.toml", pendulum),
        file("misnamed", "robot.urdf", xml),
        file("misnamed", "robot.toml", &spec.replace("robot.urdf", "nobody.urdf")),
        file("deep", "robot.urdf", xml),
        file("deep", "robot.toml", &spec.replace("1/60", &format!("1{}", "/1".repeat(200_000)))),
        file("mixed", "robot.urdf", xml),
        ("mixed", "latin.urdf".to_string(), b"<robot name=\"\xe9\"/>".to_vec()),
    ];
    for (folder, name, bytes) in files {
        write(&half.join(folder), &Files::from([(name, bytes)]))?;
    }
    write(&half.join("model"), &bench.models[1])?;
    for line in [
        "dataset --robot pendulum --transitions 200 --frames 20 --out data",
        "policy train cartpole-swingup --envs 4 --horizon 4 --iterations 1 --minibatch 8 --out run",
    ] {
        prepare(line, &half, &bench.path("said.txt"))?;
    }
    std::fs::rename(half.join("run/policy"), half.join("policy"))?;
    std::fs::rename(&half, folder).context("cannot keep the good files")
}
