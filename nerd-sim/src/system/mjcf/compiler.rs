//! Settings of MuJoCo's compiler, and poses computed by them.

use std::f64::consts::PI;

use nalgebra::{Quaternion, Rotation3, Unit};

use super::element::Element;
use crate::internal::*;

/// A shorter vector has no direction.
pub(super) const SHORT: f64 = 0.999e-6;

#[derive(Clone, Debug)]
pub(super) struct Compiler {
    degrees: bool,
    euler: String,
    pub autolimits: bool,
    /// Whether inertia comes from geoms; `None`: only for bodies without `<inertial>`.
    pub from_geoms: Option<bool>,
    /// Groups of the geoms that count towards inertia.
    pub groups: [f64; 2],
    pub balance: bool,
    pub bound_mass: f64,
    pub bound_inertia: f64,
    /// Total mass (kg); 0 or less: unchanged.
    pub total_mass: f64,
    /// Folder of meshes, beside the main file.
    pub meshes: String,
    pub strip: bool,
    /// Whether the frame of a free body is moved to its inertia's.
    pub align: bool,
    /// Whether a primitive is fitted to the box around a mesh, not to the box of equal inertia.
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
    /// From all `<compiler>` elements of a file; later ones override.
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

    /// An angle (rad).
    pub fn angle(&self, x: f64) -> f64 {
        if self.degrees { x * PI / 180.0 } else { x }
    }

    /// Moves a pose to the position and orientation that an element gives.
    pub fn pose(&self, e: &Element, pose: &mut Isometry3<f64>) -> Result<(), UrdfError> {
        if let Some(at) = e.array::<3>("pos")? {
            pose.translation = Vector3::from(at).into();
        }
        pose.rotation = self.turn(e)?.unwrap_or(pose.rotation);
        Ok(())
    }

    /// The orientation that an element gives, if it does.
    pub fn turn(&self, e: &Element) -> Result<Option<UnitQuaternion<f64>>, UrdfError> {
        // The schema lets an element have at most one of these.
        let Some(key) = ["quat", "axisangle", "xyaxes", "zaxis", "euler"].into_iter().find(|key| e.word(key).is_some()) else {
            return Ok(None);
        };
        let unit = |v: Vector3<f64>| Unit::try_new(v, SHORT).ok_or_else(|| e.refused(format!("{key} has no direction")));
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
            "zaxis" => upright(unit(Vector3::from(e.array::<3>("zaxis")?.unwrap_or_default()))?.as_ref()),
            _ => self.euler(e.array("euler")?.unwrap_or_default()),
        };
        Ok(Some(turn))
    }

    /// The rotation by three angles in the file's units and sequence.
    pub fn euler(&self, angles: [f64; 3]) -> UnitQuaternion<f64> {
        self.euler.chars().zip(angles).fold(UnitQuaternion::identity(), |turn, (axis, angle)| {
            let about = match axis.to_ascii_lowercase() {
                'x' => Vector3::x_axis(),
                'y' => Vector3::y_axis(),
                _ => Vector3::z_axis(),
            };
            let next = UnitQuaternion::from_axis_angle(&about, self.angle(angle));
            // Small letters rotate about axes that move along.
            if axis.is_lowercase() { turn * next } else { next * turn }
        })
    }
}

/// The shortest rotation that takes z to a direction.
pub(super) fn upright(z: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector3::z(), z)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), if z.z < 0.0 { PI } else { 0.0 }))
}

/// The middle, orientation and half length of a segment between two ends; z of a geom points from `to` to `from`.
pub(super) fn between(fromto: &[f64; 6]) -> (Isometry3<f64>, f64) {
    let [a, b, c, x, y, z] = *fromto;
    let (from, to) = (Vector3::new(a, b, c), Vector3::new(x, y, z));
    (Isometry3::from_parts((0.5 * (from + to)).into(), upright(&(from - to))), 0.5 * (from - to).norm())
}
