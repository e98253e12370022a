//! Settings of MuJoCo's compiler (`<compiler>`), and poses of elements, which depend on them.

use std::f64::consts::PI;

use nalgebra::{Quaternion, Rotation3, Unit};

use super::element::Element;
use crate::internal::*;

/// Length (m, or without unit) below which a vector counts as having no direction.
pub(super) const MIN_LENGTH: f64 = 0.999e-6;

#[derive(Clone, Debug)]
pub(super) struct Compiler {
    degrees: bool,
    euler: String,
    pub autolimits: bool,
    /// Whether the inertia of bodies is computed from geoms; `None`: only for bodies without `<inertial>`.
    pub from_geoms: Option<bool>,
    /// Range of geom groups that contribute inertia.
    pub groups: [f64; 2],
    pub balance: bool,
    pub bound_mass: f64,
    pub bound_inertia: f64,
    /// Total mass (kg) to which all masses are scaled; masses stay unchanged if this is not positive.
    pub total_mass: f64,
    /// Folder of meshes, relative to the main file.
    pub meshes: String,
    pub strip: bool,
    /// Whether the frame of a free body moves to its principal inertia frame.
    pub align: bool,
    /// Whether a primitive fitted to a mesh matches its bounding box instead of its box of equal inertia.
    pub around: bool,
}

impl Default for Compiler {
    fn default() -> Self {
        Self {
            degrees: true,
            euler: "xyz".into(),
            autolimits: true,
            from_geoms: None,
            groups: [0.0, 5.0],
            balance: false,
            bound_mass: 0.0,
            bound_inertia: 0.0,
            total_mass: -1.0,
            meshes: String::new(),
            strip: false,
            align: false,
            around: false,
        }
    }
}

impl Compiler {
    /// Reads all `<compiler>` elements of a file; later ones override.
    pub fn read(root: &Element) -> Result<Self, UrdfError> {
        let mut own = Self::default();
        for e in root.all("compiler") {
            own.degrees = e.one_of("angle", &[("degree", true), ("radian", false)]).unwrap_or(own.degrees);
            if let Some(order) = e.text("eulerseq") {
                if order.len() != 3 || !order.chars().all(|c| "xyzXYZ".contains(c)) {
                    return Err(e.refused(format!("eulerseq=\"{order}\": three letters of xyzXYZ are needed")));
                }
                own.euler = order.into();
            }
            own.autolimits = e.flag("autolimits").unwrap_or(own.autolimits);
            own.from_geoms = e.tristate("inertiafromgeom").unwrap_or(own.from_geoms);
            own.groups = e.array("inertiagrouprange")?.unwrap_or(own.groups);
            own.balance = e.flag("balanceinertia").unwrap_or(own.balance);
            e.set("boundmass", &mut own.bound_mass)?;
            e.set("boundinertia", &mut own.bound_inertia)?;
            e.set("settotalmass", &mut own.total_mass)?;
            own.strip = e.flag("strippath").unwrap_or(own.strip);
            own.align = e.flag("alignfree").unwrap_or(own.align);
            own.around = e.flag("fitaabb").unwrap_or(own.around);
            for key in ["assetdir", "meshdir"] {
                own.meshes = e.text(key).map_or(own.meshes, String::from);
            }
            if e.one_of("coordinate", &[("local", true), ("global", false)]) == Some(false) {
                return Err(e.refused("coordinate=\"global\" is not supported; MuJoCo itself no longer takes it"));
            }
        }
        Ok(own)
    }

    /// Converts an angle of the file to rad.
    pub fn angle(&self, x: f64) -> f64 {
        if self.degrees { x * PI / 180.0 } else { x }
    }

    /// Sets position and orientation of `pose`, as far as an element gives them.
    pub fn pose(&self, e: &Element, pose: &mut Isometry3<f64>) -> Result<(), UrdfError> {
        if let Some(at) = e.array::<3>("pos")? {
            pose.translation = Vector3::from(at).into();
        }
        pose.rotation = self.turn(e)?.unwrap_or(pose.rotation);
        Ok(())
    }

    /// The orientation that an element's attributes give, if any.
    pub fn turn(&self, e: &Element) -> Result<Option<UnitQuaternion<f64>>, UrdfError> {
        // The schema allows at most one of these attributes.
        let Some(key) = ["quat", "axisangle", "xyaxes", "zaxis", "euler"].into_iter().find(|key| e.word(key).is_some())
        else {
            return Ok(None);
        };
        let unit =
            |v: Vector3<f64>| Unit::try_new(v, MIN_LENGTH).ok_or_else(|| e.refused(format!("{key} has no direction")));
        let turn = match key {
            "quat" => {
                let [w, x, y, z] = e.array("quat")?.unwrap_or_default();
                UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.0).ok_or_else(|| e.refused("quat is zero"))?
            }
            "axisangle" => {
                let [x, y, z, angle] = e.array("axisangle")?.unwrap_or_default();
                UnitQuaternion::from_axis_angle(&unit(Vector3::new(x, y, z))?, self.angle(angle))
            }
            "xyaxes" => {
                let [a, b, c, d, f, g] = e.array("xyaxes")?.unwrap_or_default();
                let x = unit(Vector3::new(a, b, c))?;
                let y = Vector3::new(d, f, g);
                let y = unit(y - *x * x.dot(&y))?;
                let rotation = Matrix3::from_columns(&[*x, *y, x.cross(&y)]);
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation))
            }
            "zaxis" => {
                rotation_from(&Vector3::z_axis(), unit(e.array::<3>("zaxis")?.unwrap_or_default().into())?.as_ref())
            }
            _ => self.euler(e.array("euler")?.unwrap_or_default()),
        };
        Ok(Some(turn))
    }

    /// Rotation by three Euler angles, in the file's unit and sequence.
    pub fn euler(&self, angles: [f64; 3]) -> UnitQuaternion<f64> {
        self.euler.chars().zip(angles).fold(UnitQuaternion::identity(), |turn, (axis, angle)| {
            let about = match axis.to_ascii_lowercase() {
                'x' => Vector3::x_axis(),
                'y' => Vector3::y_axis(),
                _ => Vector3::z_axis(),
            };
            let next = UnitQuaternion::from_axis_angle(&about, self.angle(angle));
            // Lower-case letters are rotating axes, upper-case letters fixed axes.
            if axis.is_lowercase() { turn * next } else { next * turn }
        })
    }
}

/// Pose (midpoint and orientation) and half length (m) of the segment `fromto`; the geom's z axis points from `to` to
/// `from`.
pub(super) fn between(fromto: &[f64; 6]) -> (Isometry3<f64>, f64) {
    let [a, b, c, x, y, z] = *fromto;
    let (from, to) = (Vector3::new(a, b, c), Vector3::new(x, y, z));
    let turn = rotation_from(&Vector3::z_axis(), &(from - to));
    (Isometry3::from_parts((0.5 * (from + to)).into(), turn), 0.5 * (from - to).norm())
}
