//! Files of cases: good files, near misses of them, and a check that files written by the program are whole.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

pub use nerd_lab::report::below;
use nerd_sim::prelude::System;
use safetensors::tensor::{Dtype, SafeTensors};
use tempfile::TempDir;

use super::program;

pub type Files = BTreeMap<String, Vec<u8>>;

/// A folder in memory if the system has one: the content need not last.
pub fn scratch() -> TempDir {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }.expect("a temporary folder")
}

pub fn write(folder: &Path, files: &Files) {
    for (name, bytes) in files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap_or(folder)).expect("a folder");
        std::fs::write(&path, bytes).expect("written");
    }
}

/// Every file below a folder, by name; empty without the folder.
pub fn read(folder: &Path) -> Files {
    let name = |path: &Path| path.strip_prefix(folder).unwrap_or(path).to_string_lossy().into_owned();
    below(folder).expect("a folder").iter().map(|path| (name(path), std::fs::read(path).expect("read"))).collect()
}

/// Checks by its ending that a file written by the program is complete and holds finite numbers.
pub fn whole(path: &Path) -> Result<(), String> {
    let wrong = |reason: String| format!("{}: {reason}", path.file_name().unwrap_or_default().to_string_lossy());
    let bytes = std::fs::read(path).map_err(|e| wrong(e.to_string()))?;
    let json = |text: &[u8]| serde_json::from_slice::<serde_json::Value>(text).map(drop).map_err(|e| e.to_string());
    let checked = match path.extension().and_then(|e| e.to_str()).unwrap_or_default() {
        "json" => json(&bytes),
        // The last line of a log that grows may be cut.
        "jsonl" => bytes.split_inclusive(|b| *b == b'\n').filter(|line| line.ends_with(b"\n")).try_for_each(json),
        "csv" if bytes.last().is_some_and(|b| *b != b'\n') => Err("no end".into()),
        "csv" => {
            let odd = |cell: &&str| cell.trim().parse::<f64>().is_ok_and(|x| !x.is_finite());
            let text = String::from_utf8_lossy(&bytes);
            text.split([',', '\n']).find(odd).map_or(Ok(()), |cell| Err(format!("holds {cell}, which is not finite")))
        }
        "safetensors" => tensors(&bytes),
        "tmp" => Err("left over".into()),
        _ => Ok(()),
    };
    checked.map_err(wrong)
}

/// Checks that all tensors but `depths` are finite: distances in empty space are infinite.
fn tensors(bytes: &[u8]) -> Result<(), String> {
    let file = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    let finite = |view: &safetensors::tensor::TensorView| match view.dtype() {
        Dtype::F32 => view.data().as_chunks().0.iter().all(|b| f32::from_le_bytes(*b).is_finite()),
        Dtype::F64 => view.data().as_chunks().0.iter().all(|b| f64::from_le_bytes(*b).is_finite()),
        _ => true,
    };
    let wrong = file.tensors().into_iter().find(|(name, view)| !name.contains("depths") && !finite(view));
    wrong.map_or(Ok(()), |(name, _)| Err(format!("`{name}` is not finite")))
}

const TEXTS: [(&str, &str); 8] = [
    ("robot.toml", include_str!("assets/robot.toml")),
    ("robot.urdf", include_str!("assets/robot.urdf")),
    ("robot.csv", "traj,step,arm,d_arm\n0,0,0.1,0.2\n"),
    ("states.csv", "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n1,0,-1,0.5,0,1\n"),
    ("cartpole.csv", include_str!("assets/cartpole.csv")),
    ("cube.csv", include_str!("assets/cube.csv")),
    ("driven.csv", include_str!("assets/driven.csv")),
    ("pendulum.csv", include_str!("assets/pendulum.csv")),
];

const TRAIN: &str = "train --robot pendulum --recipe small --embedding 8 --layers 2 --history 4 --transitions 200 --frames 20 --updates 2 \
                     --batch 4 --rollouts 1";

/// Makes the good files in a folder's `f`, with the program itself.
pub fn build(folder: &Path) {
    let mut files: Files = TEXTS.iter().map(|(name, text)| (name.to_string(), text.as_bytes().to_vec())).collect();
    let [(_, spec), (_, xml), ..] = TEXTS;
    let (pendulum, urdf) = System::texts("pendulum").unwrap_or_default();
    for (name, text) in [
        // The same names, other physics.
        ("other/robot.toml", spec),
        ("other/robot.urdf", &xml.replace("mass value=\"1\"", "mass value=\"2\"")),
        ("other/pendulum.toml", pendulum),
        ("other/pendulum.urdf", &urdf.replace("mass value=\"25", "mass value=\"2")),
        ("misnamed/robot.toml", &spec.replace("robot.urdf", "nobody.urdf")),
        ("misnamed/robot.urdf", xml),
        ("deep/robot.toml", &spec.replace("1/60", &format!("1{}", "/1".repeat(200_000)))),
        ("deep/robot.urdf", xml),
        ("mixed/robot.urdf", xml),
    ] {
        files.insert(name.into(), text.into());
    }
    files.insert("mixed/latin.urdf".into(), b"<robot name=\"\xe9\"/>".into());
    let folder = &folder.join("f");
    write(folder, &files);
    for (line, from, to) in [
        ("dataset --robot pendulum --transitions 200 --frames 20".into(), "", "data"),
        ("policy train cartpole-swingup --envs 4 --horizon 4 --iterations 1 --minibatch 8".into(), "policy", "policy"),
        (TRAIN.into(), "model", "paper"),
        (format!("{TRAIN} --stream --sequence 6 --base trapezoid"), "model", "model"),
    ] {
        let made = tempfile::tempdir().expect("a temporary folder");
        let mut command = Command::new(program());
        let out = command
            .args(line.split(' '))
            .arg("--out")
            .arg(made.path())
            .env("NERD_COMMIT", "campaign")
            .output()
            .expect("started");
        assert!(out.status.success(), "`{line}` failed: {}", String::from_utf8_lossy(&out.stderr));
        write(&folder.join(to), &read(&made.path().join(from)));
    }
}
