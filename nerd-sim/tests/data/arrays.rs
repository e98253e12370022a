//! Arrays give the same log as the table they were made from, and each fault gives one line.

use std::{collections::HashMap, io::Write, path::Path};

use nerd_sim::log::Log;
use safetensors::tensor::{Dtype, TensorView};

use crate::common::{built_in, line};
use crate::tossed::{Toss, cube, folder, header, text, tosses};

type Array = (String, Vec<usize>, Vec<f64>);

/// The columns of a CSV; an empty cell is NaN.
fn columns(csv: &str) -> Vec<Array> {
    let rows: Vec<Vec<f64>> =
        csv.lines().skip(1).map(|row| row.split(',').map(|x| x.parse().unwrap_or(f64::NAN)).collect()).collect();
    let column =
        |(k, name): (usize, &str)| (name.to_string(), vec![rows.len()], rows.iter().map(|row| row[k]).collect());
    csv.lines().next().unwrap_or_default().split(',').enumerate().map(column).collect()
}

/// An npz as `numpy.savez_compressed` writes it, of dtype `kind` and with this `fortran_order`.
fn npz(arrays: &[Array], kind: &str, fortran: &str) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, shape, x) in arrays {
        zip.start_file(format!("{name}.npy"), zip::write::FileOptions::default()).expect("an entry");
        let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
        let header = format!("{{'descr': '{kind}', 'fortran_order': {fortran}, 'shape': ({shape}), }}\n");
        let mut bytes = [&b"\x93NUMPY\x01\x00"[..], &(header.len() as u16).to_le_bytes(), header.as_bytes()].concat();
        match kind {
            "<f4" => x.iter().for_each(|x| bytes.extend((*x as f32).to_le_bytes())),
            _ => x.iter().for_each(|x| bytes.extend(x.to_le_bytes())),
        }
        zip.write_all(&bytes).expect("written");
    }
    zip.finish().expect("a file").into_inner()
}

fn tensors(arrays: &[Array]) -> Vec<u8> {
    let raw: Vec<_> = arrays
        .iter()
        .map(|(name, shape, x)| (name, shape, x.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>()))
        .collect();
    let view = |(name, shape, bytes)| (name, TensorView::new(Dtype::F64, Vec::clone(shape), bytes).expect("a view"));
    safetensors::serialize(
        raw.iter().map(|(name, shape, bytes)| view((*name, *shape, bytes))),
        None::<HashMap<String, String>>,
    )
    .expect("a file")
}

/// Writes arrays to a file of this name and reads the log that names them.
fn read(folder: &Path, toml: &str, name: &str, bytes: &[u8]) -> Result<Log, nerd_sim::log::LogError> {
    std::fs::write(folder.join(name), bytes).expect("written");
    std::fs::write(folder.join("log.toml"), toml.replace("cube.csv", name)).expect("written");
    Log::read(&folder.join("log.toml"), None)
}

/// Tosses as arrays `[trajectory][row]` with their TOML: one array has all numbers of a pose, one all velocities.
fn stacked(all: &[Toss]) -> (Vec<Array>, String) {
    let flat = columns(&text(all));
    let some = |range: std::ops::Range<usize>| {
        (0..flat[0].2.len()).flat_map(|row| flat[range.clone()].iter().map(move |c| c.2[row])).collect()
    };
    let [n, rows] = [all.len(), all[0].states.len()];
    let arrays = [("t", vec![n, rows], 1..2), ("pose", vec![n, rows, 7], 2..9), ("rates", vec![n, rows, 6], 9..15)];
    let toml = ["px", "py", "pz", "qw", "qx", "qy", "qz"]
        .iter()
        .enumerate()
        .fold(header().replace("trajectory = \"toss\"\n", ""), |toml, (k, c)| {
            toml.replace(&format!("\"{c}\""), &format!("\"pose.{k}\""))
        });
    let rates = ["vx", "vy", "vz", "wx", "wy", "wz"].iter().enumerate();
    let toml = rates.fold(toml, |toml, (k, c)| toml.replace(&format!("\"{c}\""), &format!("\"rates.{k}\"")));
    (arrays.into_iter().map(|(name, shape, range)| (name.to_string(), shape, some(range))).collect(), toml)
}

#[test]
fn arrays_say_what_the_table_says() {
    let (all, folder) = (tosses(&cube(), 4, 60), folder("", header()));
    let csv = text(&all);
    let told = read(folder.path(), header(), "cube.csv", csv.as_bytes()).expect("a table");
    let same = |log: Log| {
        assert_eq!(log.trajectories, told.trajectories);
        assert_eq!(log.notes, told.notes);
    };
    same(read(folder.path(), header(), "a.npz", &npz(&columns(&csv), "<f8", "False")).expect("arrays"));
    same(read(folder.path(), header(), "a.safetensors", &tensors(&columns(&csv))).expect("arrays"));
    let (arrays, toml) = stacked(&all);
    same(read(folder.path(), &toml, "b.npz", &npz(&arrays, "<f8", "False")).expect("arrays"));
    same(read(folder.path(), &toml, "b.safetensors", &tensors(&arrays)).expect("arrays"));
    // Without times, rows are frames.
    let frames = read(folder.path(), &toml.replace("time = \"t\"\n", ""), "b.npz", &npz(&arrays[1..], "<f8", "False"))
        .expect("arrays");
    assert_eq!(frames.trajectories, told.trajectories);
    let single = read(folder.path(), &toml, "c.npz", &npz(&arrays, "<f4", "False")).expect("arrays");
    let pairs = single
        .trajectories
        .iter()
        .zip(&told.trajectories)
        .flat_map(|(a, b)| a.states.iter().flatten().zip(b.states.iter().flatten()));
    let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart > 0.0 && apart < 1e-5, "{apart} apart in single precision");

    // Trajectory numbers continue from file to file of a folder.
    std::fs::create_dir(folder.path().join("cube.npzs")).expect("a folder");
    for name in ["a", "b"] {
        let some = if name == "a" { &all[..3] } else { &all[3..] };
        std::fs::write(folder.path().join(format!("cube.npzs/{name}.npz")), npz(&stacked(some).0, "<f8", "False"))
            .expect("written");
    }
    std::fs::write(folder.path().join("log.toml"), toml.replace("cube.csv", "cube.npzs")).expect("written");
    assert_eq!(Log::read(&folder.path().join("log.toml"), None).expect("a folder").trajectories, told.trajectories);
}

/// A torque that is NaN is unknown, as an empty cell is.
#[test]
fn torques_have_gaps_in_arrays_too() {
    let (system, folder) = (built_in("cartpole"), tempfile::tempdir().expect("a folder"));
    let joints = system.robot.joints().zip(["a", "b"]).map(|(joint, k)| {
        format!("[[joint]]\nname = \"{}\"\nposition = \"q{k}\"\nvelocity = \"v{k}\"\ntorque = \"u{k}\"\n", joint.name)
    });
    let toml = format!("file = \"cube.csv\"\nrobot = \"cartpole\"\nscene = \"free\"\n{}", joints.collect::<String>());
    let row = |k: usize| {
        format!(
            "{:.9},0.1,0.5,0,{},0\n",
            0.5 * k as f64 * system.frame_time,
            if k == 7 { String::new() } else { k.to_string() }
        )
    };
    let csv: String = ["qa,qb,va,vb,ua,ub\n".to_string()].into_iter().chain((0..20).map(row)).collect();
    let told = read(folder.path(), &toml, "cube.csv", csv.as_bytes()).expect("a table");
    assert_eq!(told.trajectories.iter().map(|t| t.states.len()).collect::<Vec<_>>(), [8, 12], "{:?}", told.notes);
    let found = read(folder.path(), &toml, "a.npz", &npz(&columns(&csv), "<f8", "False")).expect("arrays");
    assert_eq!((found.trajectories, found.notes), (told.trajectories, told.notes));
}

#[test]
fn arrays_that_cannot_be_right_are_refused() {
    let (all, folder) = (tosses(&cube(), 3, 60), folder("", header()));
    let (arrays, toml) = stacked(&all);
    let changed = |f: &dyn Fn(&mut Vec<Array>)| {
        let mut arrays = arrays.clone();
        f(&mut arrays);
        npz(&arrays, "<f8", "False")
    };
    let good = changed(&|_| ());
    let short = changed(&|a| (a[1].1, a[1].2) = (vec![3, 59, 7], a[1].2[..3 * 59 * 7].to_vec()));
    let one = |name: &str, to: &str| toml.replace(&format!("\"{name}\""), &format!("\"{to}\""));
    let cases: [(&str, Vec<u8>, String, &[&str]); 12] = [
        ("no array", good.clone(), one("rates.2", "speed.2"), &["a.npz", "`speed.2`", "t, pose, rates"]),
        ("no component", good.clone(), one("rates.5", "rates.6"), &["`rates.6`", "[3, 60, 6]"]),
        ("no component named", good.clone(), one("rates.5", "rates"), &["`rates`", "[3, 60, 6]", "NAME.0"]),
        ("rows", short, toml.clone(), &["`t` and `pose.0`", "3 x 60", "3 x 59"]),
        (
            "NaN",
            changed(&|a| a[1].2[(60 + 17) * 7 + 2] = f64::NAN),
            toml.clone(),
            &["trajectory 1, row 17, column `pose.2`", "NaN"],
        ),
        ("length", changed(&|a| a[1].2[3] *= 2.0), toml.clone(), &["trajectory 0, row 0", "quaternion of length"]),
        (
            "time",
            changed(&|a| a[0].2[61] = 0.0),
            toml.clone(),
            &["trajectory 1, row 1, column `t`", "trajectory 1, row 0", "time must go on"],
        ),
        ("huge", changed(&|a| a[2].2[5] = 1e300), toml.clone(), &["trajectory 0, row 0", "at most"]),
        ("type", npz(&arrays, "<f2", "False"), toml.clone(), &["`t`", "<f2", "float32"]),
        ("order", npz(&arrays, "<f8", "True"), toml.clone(), &["numpy.ascontiguousarray(t)"]),
        ("damaged", changed(&|a| a[1].1 = vec![3, 60, 8]), toml.clone(), &["`pose`", "damaged"]),
        ("cut", good[..good.len() / 2].to_vec(), toml.clone(), &["a.npz"]),
    ];
    for (what, bytes, toml, words) in cases {
        let said = line(read(folder.path(), &toml, "a.npz", &bytes));
        assert!(words.iter().all(|word| said.contains(word)), "{what}: `{said}` does not say {words:?}");
    }
    let said = line(read(folder.path(), &toml, "a.safetensors", &good));
    assert!(said.contains("a.safetensors"), "{said}");
}
