//! Logs of measurements: reading, corrections with notes, and refusals that name the position. A solver makes the
//! measurements, so every true value is known.

use std::path::Path;

use crate::common::{built_in, line};
use crate::tossed::{Toss, cube, folder, header, stamp, text, tosses};
use nerd_sim::{log::Log, prelude::*};

fn read(rows: &str, toml: &str) -> Log {
    Log::read(&folder(rows, toml).path().join("cube.log.toml"), None).expect("a log")
}

/// A TOML that names no velocities.
fn bare() -> String {
    header().replace("velocity = [\"vx\", \"vy\", \"vz\"]\n", "").replace("ang_vel = [\"wx\", \"wy\", \"wz\"]\n", "")
}

#[test]
fn states_come_back_as_a_solver_had_them() {
    let all = tosses(&cube(), 3, 60);
    let log = read(&text(&all), header());
    assert_eq!(log.trajectories.len(), 3);
    assert!(log.notes.is_empty(), "{:?}", log.notes);
    for (toss, found) in all.iter().zip(&log.trajectories) {
        let apart = toss
            .states
            .iter()
            .flatten()
            .zip(found.states.iter().flatten())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(found.states.len() == 60 && apart < 1e-5, "toss {}: {apart} from what was written", toss.id);
    }
}

#[test]
fn what_is_missing_is_made_and_said() {
    let all = tosses(&cube(), 2, 60);
    let log = read(&text(&all), &bare());
    assert!(log.notes.iter().any(|n| n.contains("central differences")), "{:?}", log.notes);
    let speed = |s: &[f64]| (s[7].powi(2) + s[8].powi(2) + s[9].powi(2)).sqrt();
    let (told, made) = (speed(&all[0].states[4]), speed(&log.trajectories[0].states[4]));
    assert!((told - made).abs() < 0.02 * told, "spin {made} rad/s from differences, {told} in truth");

    let gap: Vec<Toss> = all.iter().map(|t| Toss { skip: 30..34, ..t.clone() }).collect();
    let log = read(&text(&gap), header());
    assert_eq!(log.trajectories.len(), 4, "each cut in two: {:?}", log.notes);
    assert!(log.notes.iter().any(|n| n.contains("2 gaps") && n.contains("line 32")), "{:?}", log.notes);

    let slow: Vec<Toss> = all.iter().map(|t| Toss { stride: 2, ..t.clone() }).collect();
    let log = read(&text(&slow), header());
    assert!(log.notes.iter().any(|n| n.contains("resampled")), "{:?}", log.notes);
    let (a, b) = (&all[0].states[5], &log.trajectories[0].states[5]);
    assert!(
        (a[2] - b[2]).abs() < 1e-3 && log.trajectories[0].states.len() == 59,
        "{} m for {} m between two rows",
        b[2],
        a[2]
    );
}

#[test]
fn a_turned_copy_is_left_out_and_a_hand_lets_go() {
    let mut all = tosses(&cube(), 2, 60);
    all.push(Toss { id: 9, turned: 1.1, ..all[0].clone() });
    let log = read(&text(&all), header());
    assert_eq!(log.trajectories.iter().map(|t| t.id).collect::<Vec<_>>(), [0, 1], "{:?}", log.notes);
    assert!(log.notes[0].starts_with("1 of 3"), "{:?}", log.notes);

    let held: Vec<Toss> = all[..2].iter().map(|t| Toss { held: 20, ..t.clone() }).collect();
    let log = read(&text(&held), header());
    assert!(log.notes.iter().any(|n| n.starts_with("2 trajectories do not fall freely")), "{:?}", log.notes);
    let left = log.trajectories[0].states.len();
    // The start of a fall is known to within half of the 12 frames that identify it.
    assert!((54..=66).contains(&left), "{left} frames are left of 80, 60 of them free");
}

/// The table with `f` applied to the numbers of every row.
fn changed(table: &str, f: &dyn Fn(usize, &mut [f64])) -> String {
    let (head, rows) = table.split_once('\n').expect("a head");
    let row = |(k, line): (usize, &str)| {
        let mut x: Vec<f64> = line.split(',').map(|c| c.parse().expect("a number")).collect();
        f(k, &mut x);
        x.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
    };
    [vec![head.to_string()], rows.lines().enumerate().map(row).collect()].concat().join("\n")
}

/// Odd tables that can be read: rounded times, semicolons, angular velocities a third too large, a glitch, times 10 %
/// short. A table without rows is refused.
#[test]
fn what_is_odd_is_read_and_said() {
    let all = tosses(&cube(), 3, 60);
    let good = text(&all);
    let cells = |f: &dyn Fn(usize, &mut [f64])| changed(&good, f);
    let spun = |k: f64| cells(&|_, x| x[12..15].iter_mut().for_each(|w| *w *= k));
    let cases: [(&str, String, Option<&[&str]>); 4] = [
        ("times to four digits", cells(&|_, x| x[1] = (1e4 * x[1]).round() / 1e4), None),
        ("semicolons", good.replace(',', ";"), None),
        ("rates a third too large", spun(4.0 / 3.0), Some(&["wx, wy, wz", "times 0.7"])),
        ("a glitch", cells(&|k, x| x[2] += if k == 20 { 1e4 } else { 0.0 }), Some(&["line 23, column `px`", "glitch"])),
    ];
    for (what, rows, words) in cases {
        let log = read(&rows, if what == "a glitch" { bare() } else { header().into() }.as_str());
        let (states, notes) = (log.trajectories[0].states.len(), log.notes.join("; "));
        assert_eq!(states, 60, "{what}: {notes}");
        match words {
            None => assert!(notes.is_empty(), "{what}: {notes}"),
            Some(words) => {
                assert!(words.iter().all(|word| notes.contains(word)), "{what}: `{notes}` does not say {words:?}")
            }
        }
    }
    let quick = read(&cells(&|_, x| x[1] *= 0.9), &bare());
    let (own, notes) = (quick.system.frame_time, quick.notes.join("; "));
    assert!(notes.contains(&format!("`frame_time = {:.6}`", 0.9 * own)), "{notes}");
    let empty =
        line(Log::read(&folder(good.lines().next().expect("a head"), header()).path().join("cube.log.toml"), None));
    assert!(empty.contains("cube.csv") && empty.contains("no rows"), "{empty}");
}

/// Error lines that name fault, position and correction.
#[test]
fn what_cannot_be_right_is_refused() {
    let all = tosses(&cube(), 3, 60);
    let good = text(&all);
    let changed = |f: &dyn Fn(&mut [f64])| changed(&good, &|_, x| f(x));
    let rates = |k: f64| changed(&|x| x[12..15].iter_mut().for_each(|w| *w *= k));
    let cases: [(&str, String, String, &[&str]); 15] = [
        ("a column", good.replace("vz", "up"), header().into(), &["cube.csv", "column `vz`"]),
        ("the order", good.clone(), header().replace("wxyz", "xyzw"), &["qw, qx, qy, qz", "order = \"wxyz\""]),
        ("the axes", good.clone(), header().replace("\"body\"", "\"world\""), &["wx, wy, wz", "axes = \"body\""]),
        ("degrees", rates(180.0 / std::f64::consts::PI), header().into(), &["wx, wy, wz", "degrees taken for radians"]),
        (
            "radians",
            good.clone(),
            header().replace("[root]", "units = { angle = \"deg\" }\n[root]"),
            &["radians taken for degrees"],
        ),
        (
            "speeds in mm/s",
            changed(&|x| x[9..12].iter_mut().for_each(|v| *v *= 1e3)),
            header().into(),
            &["vx, vy, vz", "1000"],
        ),
        ("mm", changed(&|x| (2..5).chain(9..12).for_each(|k| x[k] *= 1e3)), header().into(), &["a factor of 1000"]),
        ("time", good.replacen(&stamp(0, 7), &stamp(0, 1), 1), header().into(), &["line 9", "time must go on"]),
        ("a cut file", good[..good.len() - 40].into(), header().into(), &["cube.csv"]),
        ("no number", good.replacen(&stamp(0, 3), "0,nan", 1), header().into(), &["line 5", "column `t`"]),
        (
            "s told as ns",
            good.clone(),
            header().replace("[root]", "units = { time = \"ns\" }\n[root]"),
            &["columns vx, vy, vz"],
        ),
        ("us told as s", changed(&|x| x[1] *= 1e6), bare(), &["line 2", "units.time"]),
        ("a column twice", good.clone(), header().replace("\"py\"", "\"px\""), &["`px`", "two things"]),
        ("a huge number", changed(&|x| x[2] = 1e300), header().into(), &["line 2", "at most"]),
        ("a key", good.clone(), header().replace("time =", "clock ="), &["cube.log.toml", "clock"]),
    ];
    for (what, rows, toml, words) in cases {
        let said = line(Log::read(&folder(&rows, &toml).path().join("cube.log.toml"), None));
        assert!(words.iter().all(|word| said.contains(word)), "{what}: `{said}` does not say {words:?}");
    }
}

/// A slide in millimetres, and a hinge in degrees that passes 180; velocities come from differences without a jump.
#[test]
fn joints_have_units_of_their_own_and_no_seams() {
    let folder = tempfile::tempdir().expect("a folder");
    let toml = "file = \"c.csv\"\nrobot = \"cartpole\"\nscene = \"free\"\ntime = \"t\"\nunits = { length = \"mm\", angle = \"deg\" }\n\
                [[joint]]\nname = \"NAME0\"\nposition = \"x\"\n[[joint]]\nname = \"NAME1\"\nposition = \"a\"\n";
    let system = built_in("cartpole");
    let names: Vec<&str> = system.robot.joints().map(|j| j.name.as_str()).collect();
    let toml = toml.replace("NAME0", names[0]).replace("NAME1", names[1]);
    let mut rows = String::from("t,x,a\n");
    let (dt, speed, spin) = (system.frame_time, 0.5, 9.0);
    for k in 0..80 {
        let t = f64::from(k) * dt;
        // Kept in [-180, 180), as some encoders do.
        let angle = ((spin * t).to_degrees() + 180.0).rem_euclid(360.0) - 180.0;
        rows += &format!("{t:.9},{:.9},{angle:.9}\n", 1000.0 * speed * t);
    }
    std::fs::write(folder.path().join("c.csv"), rows).expect("written");
    std::fs::write(folder.path().join("c.log.toml"), toml).expect("written");
    let log = Log::read(&folder.path().join("c.log.toml"), None).expect("a log");
    for state in &log.trajectories[0].states {
        let off = [(state[2] - speed).abs(), (state[3] - spin).abs()];
        assert!(
            off[0] < 1e-6 && off[1] < 1e-6,
            "rates {} m/s and {} rad/s, {speed} and {spin} in truth",
            state[2],
            state[3]
        );
    }
}

/// Long rests, where velocities are noise, do not affect the check of velocities in motion.
#[test]
fn rest_refuses_nothing() {
    let mut all = tosses(&cube(), 3, 60);
    for toss in &mut all {
        let mut last = toss.states[59].clone();
        last[7..].fill(0.0);
        for k in 0..150 {
            let mut state = last.clone();
            state[0] += if k % 2 == 0 { 1e-4 } else { -1e-4 };
            toss.states.push(state);
        }
    }
    let log = read(&text(&all), header());
    assert_eq!(log.trajectories[0].states.len(), 210);
}

/// A gravity 2 % above the measured free fall, as from a length scale 2 % short, gives a note only.
#[test]
fn free_fall_tells_the_scale() {
    let log = read(&text(&tosses(&cube(), 3, 60)), &header().replace("cube.urdf", "heavy.urdf"));
    assert!(
        log.notes.iter().any(|n| n.contains("free fall is 9.81") && n.contains("gravity is 10.000")),
        "{:?}",
        log.notes
    );
}

/// The sample that comes with the crate.
#[test]
fn the_sample_is_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/logs/cube.log.toml");
    let log = Log::read(&path, None).expect("the sample");
    assert_eq!((log.trajectories.len(), log.system.robot.contact_points.len()), (10, 8));
    assert!(log.notes.iter().any(|n| n.contains("free fall is 9.6")), "{:?}", log.notes);
    assert!(log.trajectories.iter().all(|t| t.states.iter().flatten().all(|x| x.is_finite())));
    assert!((log.system.frame_time - 1.0 / 148.0).abs() < 1e-12);
}

/// Tables in a folder, some torques unknown, one table with four rows a frame. Every sequence of frames occurs in the
/// pieces of a recording once, except in a trajectory's last piece.
#[test]
fn a_folder_of_tables_becomes_pieces() {
    let folder = tempfile::tempdir().expect("a folder");
    let system = built_in("pendulum");
    let names: Vec<&str> = system.robot.joints().map(|j| j.name.as_str()).collect();
    let joint = |k: usize| {
        format!("[[joint]]\nname = \"{}\"\nposition = \"q{k}\"\nvelocity = \"v{k}\"\ntorque = \"u{k}\"\n", names[k])
    };
    let toml =
        format!("file = \"runs\"\nrobot = \"pendulum\"\nscene = \"ground1\"\ntime = \"t\"\n{}{}", joint(0), joint(1));
    std::fs::create_dir(folder.path().join("runs")).expect("a folder");
    let write = |name: &str, rows: usize, per: usize, torque: &dyn Fn(usize) -> String| {
        let dt = system.frame_time / per as f64;
        let row = |k: usize| format!("{:.9},{:.9},0.5,0.3,0,{},0,7\n", k as f64 * dt, 0.3 * k as f64 * dt, torque(k));
        let text: String = ["t,q0,q1,v0,v1,u0,u1,run\n".to_string()].into_iter().chain((0..rows).map(row)).collect();
        std::fs::write(folder.path().join("runs").join(name), text).expect("written");
    };
    // b.csv lacks the torque of a middle row and of its last; c.csv has four rows a frame.
    write("a.csv", 31, 1, &|k| k.to_string());
    write("b.csv", 25, 1, &|k| if k == 9 || k == 24 { String::new() } else { k.to_string() });
    write("c.csv", 41, 4, &|k| k.to_string());
    let path = folder.path().join("log.toml");
    std::fs::write(&path, &toml).expect("written");
    let log = Log::read(&path, None).expect("a log");
    let sizes: Vec<(u64, usize)> = log.trajectories.iter().map(|t| (t.id, t.states.len())).collect();
    assert_eq!(sizes, [(0, 31), (1, 10), (1, 15), (2, 11)], "{:?}", log.notes);
    assert!(log.notes.iter().any(|n| n.starts_with("1 rows")), "{:?}", log.notes);
    // Times are written to the nanosecond.
    let near = |a: f64, b: f64| (a - b).abs() < 1e-4;
    assert!(
        near(log.trajectories[3].torques[2][0], 9.5),
        "{:?} is not the mean of 8 to 11",
        log.trajectories[3].torques[2]
    );

    let (frames, sequence) = (8, 3);
    let recording = log.recording(&log.trajectories, frames, sequence - 1).expect("pieces");
    recording.check(&system).expect("as the robot needs");
    let starts: Vec<f64> = recording.torques.chunks(2 * frames).map(|piece| piece[0]).collect();
    let told = [0.0, 6.0, 12.0, 18.0, 22.0, 0.0, 1.0, 10.0, 16.0, 1.5, 9.5];
    assert!(
        starts.len() == told.len() && starts.iter().zip(told).all(|(a, b)| near(*a, b)),
        "pieces begin at {starts:?}, not {told:?}"
    );
    let mut first: Vec<u64> = Vec::new();
    for piece in recording.torques.chunks(2 * frames).take(5) {
        first.extend(piece.chunks(2).take(frames + 1 - sequence).map(|t| t[0] as u64));
    }
    first.dedup();
    first.sort_unstable();
    first.dedup();
    assert_eq!(first, (0..=27).collect::<Vec<_>>(), "sequences of {sequence} frames begin at each of them");
    // Contacts are computed from the robot's geometry.
    let mut events = Vec::new();
    contacts(
        &system,
        &system.scene("ground1").expect("a scene"),
        &recording.states[..4],
        &mut Data::new(&system.robot),
        &mut events,
    );
    let depths: Vec<f64> = events.iter().map(|e| e.distance).collect();
    assert_eq!(recording.depths[..depths.len()], depths[..]);

    let one = |toml: &str| {
        std::fs::write(&path, toml).expect("written");
        Log::read(&path, None)
    };
    let some = one(&toml.replace("time =", "only = [0, 2]\ntime =")).expect("a log");
    assert_eq!(some.trajectories.iter().map(|t| t.id).collect::<Vec<_>>(), [0, 2]);
    for (what, toml, words) in [
        ("another", toml.replace("time =", "only = [7]\ntime ="), "no trajectory 7"),
        ("twice", toml.replace("time =", "trajectory = \"run\"\ntime ="), "another table"),
        ("none", toml.replace("\"runs\"", "\".\""), "no .csv"),
    ] {
        let said = line(one(&toml));
        assert!(said.contains(words), "{what}: {said}");
    }
}
