//! The tosses as they were measured: tosses.csv and tosses_meta.csv of one folder.
//!
//! `tosses.csv`: `toss, step, p? (m), q? (w first), v? (m/s, world), w? (rad/s, BODY axes)`, one row every 1/148 s. A row's
//! velocity is the difference to the row before it. `tosses_meta.csv`: `toss, duplicate_of, first_contact_step`. A toss that
//! is another's copy, turned and shifted, is left out: it would weigh twice, and sit on both sides of a split.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};

use super::MeasuredError;
use crate::table::Table;

/// Seconds between two rows.
pub const DT: f64 = 1.0 / 148.0;
/// Largest number of a row in its toss.
const LENGTH: u64 = 1_000_000;

/// One measured moment; everything in world axes.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Where the cube is.
    pub pose: Isometry3<f64>,
    /// Velocity of its centre (m/s).
    pub velocity: Vector3<f64>,
    /// Angular velocity (rad/s).
    pub spin: Vector3<f64>,
}

/// One toss.
#[derive(Clone, Debug)]
pub struct Toss {
    /// Its number in the file.
    pub id: u64,
    /// First sample with a corner below 2 mm over the table.
    pub first_contact: usize,
    /// What was measured.
    pub samples: Vec<Sample>,
}

impl Sample {
    /// The state `[q, qd]`: quaternion x y z w, twist about the world's origin.
    pub fn state(&self) -> Vec<f64> {
        let (p, w) = (self.pose.translation.vector, self.spin);
        let twist = self.velocity - w.cross(&p);
        [p.as_slice(), self.pose.rotation.coords.as_slice(), w.as_slice(), twist.as_slice()].concat()
    }

    /// With lengths divided by `scale`.
    pub fn scaled(&self, scale: f64) -> Self {
        let p = self.pose.translation.vector / scale;
        Self { pose: Isometry3::from_parts(p.into(), self.pose.rotation), velocity: self.velocity / scale, spin: self.spin }
    }
}

/// The tosses of a folder, by id, copies left out.
///
/// # Errors
/// [`MeasuredError::Absent`], or what is wrong in the files, with line and column.
pub fn read(folder: &Path) -> Result<Vec<Toss>, MeasuredError> {
    let (path, meta) = (folder.join("tosses.csv"), folder.join("tosses_meta.csv"));
    if let Some(absent) = [&path, &meta].into_iter().find(|p| !p.exists()) {
        return Err(MeasuredError::Absent(absent.clone()));
    }
    let mut table = Table::open(&meta)?;
    let columns = table.columns(&["toss", "duplicate_of", "first_contact_step"])?;
    let mut tosses = BTreeMap::new();
    table.rows(|row| {
        if row.cell(columns[1]).is_empty() {
            let (id, first_contact) = (row.whole(columns[0], u64::MAX)?, row.whole(columns[2], LENGTH)? as usize);
            tosses.insert(id, Toss { id, first_contact, samples: Vec::new() });
        }
        Ok(())
    })?;
    if tosses.is_empty() {
        return Err(table.wrong("no tosses".into()).into());
    }
    let mut table = Table::open(&path)?;
    let columns = table.columns(&["toss", "step", "px", "py", "pz", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz"])?;
    table.rows(|row| {
        let Some(toss) = tosses.get_mut(&row.whole(columns[0], u64::MAX)?) else { return Ok(()) };
        let (step, due) = (row.whole(columns[1], LENGTH)? as usize, toss.samples.len());
        if step != due {
            return Err(row.wrong(&format!(": step {step} of toss {}, step {due} was due", toss.id)));
        }
        let x = row.numbers(&columns[2..])?;
        row.unit(&columns[5..9], &x[3..7])?;
        let vector = |k: usize| Vector3::new(x[k], x[k + 1], x[k + 2]);
        let turn = UnitQuaternion::new_normalize(Quaternion::new(x[3], x[4], x[5], x[6]));
        let pose = Isometry3::from_parts(vector(0).into(), turn);
        toss.samples.push(Sample { pose, velocity: vector(7), spin: turn * vector(10) });
        Ok(())
    })?;
    if let Some(toss) = tosses.values().find(|t| t.samples.is_empty()) {
        return Err(table.wrong(format!("no rows of toss {}, which {} names", toss.id, meta.display())).into());
    }
    Ok(tosses.into_values().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube that flies turning about an oblique axis, written as the files are, with a copy.
    fn write(folder: &Path) -> Vec<(UnitQuaternion<f64>, Vector3<f64>)> {
        let spin = Vector3::new(3.0, -5.0, 2.0);
        let first = UnitQuaternion::from_euler_angles(0.7, -0.4, 1.9);
        let mut text = String::from("toss,step,t,px,py,pz,qw,qx,qy,qz,vx,vy,vz,wx,wy,wz\n");
        let mut poses = Vec::new();
        for step in 0..6 {
            let t = step as f64 * DT;
            let q = UnitQuaternion::from_scaled_axis(spin * t) * first;
            let (p, w) = (Vector3::new(0.1 + 0.5 * t, -0.2 * t, 1.0), q.inverse() * spin);
            poses.push((q, p));
            for toss in [4, 9] {
                text += &format!(
                    "{toss},{step},{t},{},{},{},{},{},{},{},0.5,-0.2,0,{},{},{}\n",
                    p.x, p.y, p.z, q.w, q.i, q.j, q.k, w.x, w.y, w.z
                );
            }
        }
        std::fs::write(folder.join("tosses.csv"), text).expect("written");
        let meta = "toss,steps,duplicate_of,first_contact_step\n4,6,,5\n9,6,4,5\n";
        std::fs::write(folder.join("tosses_meta.csv"), meta).expect("written");
        poses
    }

    /// Body-frame omega taken for world-frame omega still looks like a plausible tumble; only the next pose can tell.
    #[test]
    fn omega_is_turned_into_world_axes_and_copies_are_left_out() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let poses = write(folder.path());
        let tosses = read(folder.path()).expect("tosses");
        assert_eq!(tosses.iter().map(|t| (t.id, t.samples.len(), t.first_contact)).collect::<Vec<_>>(), [(4, 6, 5)]);
        let samples = &tosses[0].samples;
        for (sample, (q, p)) in samples.iter().zip(&poses) {
            assert!(sample.pose.rotation.angle_to(q) < 1e-9 && (sample.pose.translation.vector - p).norm() < 1e-12);
            assert_eq!(sample.state()[3..7], *sample.pose.rotation.coords.as_slice(), "x y z w");
        }
        for pair in samples.windows(2) {
            let turn = pair[1].pose.rotation * pair[0].pose.rotation.inverse();
            let difference = turn.scaled_axis() / DT;
            assert!((difference - pair[0].spin).norm() < 1e-6, "{difference} against {}", pair[0].spin);
            // The state's twist is about the world's origin: at the cube's centre it is the velocity again.
            let x = pair[0].state();
            let (p, w, v) = (Vector3::new(x[0], x[1], x[2]), Vector3::new(x[7], x[8], x[9]), Vector3::new(x[10], x[11], x[12]));
            let moved = (pair[1].pose.translation.vector - pair[0].pose.translation.vector) / DT;
            assert!((v + w.cross(&p) - moved).norm() < 1e-9);
        }
    }

    #[test]
    fn what_is_wrong_is_named_in_one_line() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let error = |what: &str| {
            let error = read(folder.path()).expect_err("an error").to_string();
            assert!(error.contains(what) && !error.contains('\n'), "`{error}` does not name {what}");
        };
        error("no toss data");
        write(folder.path());
        let path = folder.path().join("tosses.csv");
        let text = std::fs::read_to_string(&path).expect("read");
        for (from, to, what) in [("4,0,0,", "4,0,0,nan", "line 2"), ("\n4,1,", "\n4,7,", "step 7 of toss 4"), ("wz", "wq", "column `wz`")] {
            std::fs::write(&path, text.replacen(from, to, 1)).expect("written");
            error(what);
        }
    }
}
