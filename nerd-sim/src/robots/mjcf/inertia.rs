//! Computes masses and inertias of bodies by the rules of MuJoCo's compiler.

use std::f64::consts::PI;

use super::geom::{Geom, Type};
use super::model::{Body, Mesh, Model};
use super::tree::Tree;
use super::volume::{MassOf, properties};
use crate::internal::*;

/// [`MIN_INERTIAL`]: least mass (kg) and inertia (kg m^2) that counts as positive. [`MIN_VOLUME`]: least such volume
/// (m^3).
const MIN_INERTIAL: f64 = 1e-15;
const MIN_VOLUME: f64 = 1e-14;

/// Inertias of all bodies in their body frames; zero for static bodies.
pub(super) fn inertias(tree: &Tree) -> Result<Vec<BodyInertia>, UrdfError> {
    let model = tree.model;
    let total = model.bodies[0].source.compiler.total_mass;
    let inertia = |(id, body): (usize, &Body)| {
        // Where the file prescribes the total mass, static bodies count towards it, except the world.
        let counts = id > 0 && total > 0.0;
        if model.still(id) && !counts { Ok(BodyInertia::default()) } else { of(body, model) }
    };
    let mut all = model.bodies.iter().enumerate().map(inertia).collect::<Result<Vec<_>, _>>()?;
    if let Some(id) = (0..all.len()).find(|id| !model.bodies[*id].joints.is_empty() && !carries(model, &all, *id)) {
        return Err(model.bodies[id]
            .element
            .refused("it moves, and has no mass or no inertia; give it a geom with a mass, or an <inertial>"));
    }
    let sum = all.iter().map(|i| i.mass).sum::<f64>();
    if total > 0.0 && sum > 0.0 {
        all.iter_mut().for_each(|i| (i.mass, i.inertia) = (i.mass * total / sum, i.inertia * total / sum));
    }
    Ok(all)
}

/// Whether a body, or a body fixed to it, has mass and inertia.
fn carries(model: &Model, all: &[BodyInertia], id: usize) -> bool {
    let own = &all[id];
    let fixed = |k: &usize| model.bodies[*k].parent == id && model.bodies[*k].joints.is_empty();
    own.mass >= MIN_INERTIAL && own.inertia.symmetric_eigenvalues().min() >= MIN_INERTIAL
        || (id + 1..all.len()).filter(fixed).any(|k| carries(model, all, k))
}

/// Inertia of a body in its frame.
fn of(body: &Body, model: &Model) -> Result<BodyInertia, UrdfError> {
    let compiler = &body.source.compiler;
    let mut sum = BodyInertia::default();
    let mut add = |pose: &Isometry3<f64>, mass: f64, inertia: Matrix3<f64>| {
        let part = BodyInertia { mass, com: Vector3::zeros(), inertia };
        sum = sum.welded(&part.transformed(&pose.rotation.to_rotation_matrix(), &pose.translation.vector));
    };
    match &body.inertial {
        Some((pose, mass, inertia)) if compiler.from_geoms != Some(true) => add(pose, *mass, *inertia),
        _ if compiler.from_geoms == Some(false) => {}
        _ => {
            let [first, last] = compiler.groups;
            let weighs =
                |geom: &&Geom| (first..=last).contains(&geom.group) && geom.mass.unwrap_or(geom.density) != 0.0;
            for geom in body.geoms.iter().filter(weighs) {
                if let Some((pose, mass, inertia)) =
                    mass_of(geom, model).map_err(|reason| body.element.refused(reason))?
                {
                    add(&pose, mass, inertia);
                }
            }
        }
    }
    let mut principal = sum.inertia.symmetric_eigen();
    let d = &mut principal.eigenvalues;
    let broken = 2.0 * d.max() > d.sum() + 1e-10 * d.max().max(1e-300);
    if broken && !compiler.balance && 2.0 * d.max() > d.sum() * (1.0 + 1e-6) + 1e-14 {
        return Err(body.element.refused("no body has its inertia, of which one principal moment is larger than the other two together; mend it, or write <compiler balanceinertia=\"true\"/>"));
    }
    sum.mass = sum.mass.max(compiler.bound_mass);
    if compiler.bound_inertia > 0.0 || broken && compiler.balance {
        *d = d.map(|x| x.max(compiler.bound_inertia));
        let balanced = 2.0 * d.max() > d.sum() && compiler.balance;
        *d = if balanced { Vector3::repeat(d.mean()) } else { *d };
        sum.inertia = principal.eigenvectors * Matrix3::from_diagonal(d) * principal.eigenvectors.transpose();
    }
    Ok(sum)
}

/// Pose of the centre of mass, mass (kg), and inertia about it (kg m^2).
type Part = (Isometry3<f64>, f64, Matrix3<f64>);

/// Contribution of a geom to the inertia of its body; `None` for a geom without volume.
fn mass_of(geom: &Geom, model: &Model) -> Result<Option<Part>, String> {
    if geom.kind == Type::Mesh {
        let mesh = geom.mesh.as_ref().and_then(|name| model.mesh(name)).ok_or("its mesh is not there")?;
        if geom.shell {
            return Err("shellinertia is not for meshes; write inertia=\"shell\" at the <mesh>".into());
        }
        let own = mesh.weighed()?;
        let factor = geom.mass.map_or(geom.density, |mass| mass / own.mass);
        let pose = geom.pose * Isometry3::from(own.com);
        return Ok(Some((pose, own.mass * factor, own.inertia * factor)));
    }
    let Some((volume, unit)) = moments(geom) else { return Ok(None) };
    // A geom of negligible volume has no mass, even with a `mass` attribute.
    let mass = geom.mass.filter(|_| volume > MIN_VOLUME).unwrap_or(geom.density * volume);
    Ok(Some((geom.pose, mass, Matrix3::from_diagonal(&(unit * mass)))))
}

/// Volume (m^3) and principal moments per unit mass (m^2) of a primitive. For a shell, the area (m^2) replaces the
/// volume.
fn moments(geom: &Geom) -> Option<(f64, Vector3<f64>)> {
    let size = Vector3::from(geom.size);
    let r = size.x;
    let h = 2.0 * size.y;
    let round = |across: f64, along: f64| Vector3::new(across, across, along);
    if geom.shell {
        return shell(geom.kind, &size);
    }
    Some(match geom.kind {
        Type::Sphere => (4.0 / 3.0 * PI * r.powi(3), Vector3::repeat(0.4 * r * r)),
        Type::Cylinder => (PI * r * r * h, round((3.0 * r * r + h * h) / 12.0, 0.5 * r * r)),
        Type::Capsule => {
            let ends = 4.0 * r / (4.0 * r + 3.0 * h);
            let across =
                (1.0 - ends) * (3.0 * r * r + h * h) / 12.0 + ends * (0.4 * r * r + 0.25 * h * h + 0.375 * h * r);
            (PI * r * r * (h + 4.0 / 3.0 * r), round(across, (1.0 - ends) * 0.5 * r * r + ends * 0.4 * r * r))
        }
        Type::Box | Type::Ellipsoid => {
            let (volume, share) = if geom.kind == Type::Box { (8.0, 1.0 / 3.0) } else { (4.0 / 3.0 * PI, 0.2) };
            let s = size.component_mul(&size);
            (volume * size.product(), Vector3::new(s.y + s.z, s.x + s.z, s.x + s.y) * share)
        }
        _ => return None,
    })
}

/// Area (m^2) and principal moments per unit mass (m^2) of a primitive's shell.
fn shell(kind: Type, size: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let r = size.x;
    let h = 2.0 * size.y;
    match kind {
        Type::Sphere => Some((4.0 * PI * r * r, Vector3::repeat(2.0 / 3.0 * r * r))),
        Type::Box => {
            // Pairs of opposite plates, one pair per axis.
            let [x, y, z] = [size.x, size.y, size.z];
            let plates = [
                (4.0 * y * z, x, [0.0, y * y, z * z]),
                (4.0 * x * z, y, [x * x, 0.0, z * z]),
                (4.0 * x * y, z, [x * x, y * y, 0.0]),
            ];
            let mut area = 0.0;
            let mut squares = Vector3::zeros();
            for (axis, (one, off, spread)) in plates.into_iter().enumerate() {
                area += 2.0 * one;
                let mut square = Vector3::from(spread) / 3.0;
                square[axis] = off * off;
                squares += square * 2.0 * one;
            }
            squares /= area;
            Some((area, Vector3::new(squares.y + squares.z, squares.x + squares.z, squares.x + squares.y)))
        }
        Type::Cylinder => {
            let side = 2.0 * PI * r * h;
            let caps = 2.0 * PI * r * r;
            let along = (side * r * r + caps * 0.5 * r * r) / (side + caps);
            let across = (side * (0.5 * r * r + h * h / 12.0) + caps * (0.25 * r * r + 0.25 * h * h)) / (side + caps);
            Some((side + caps, Vector3::new(across, across, along)))
        }
        Type::Capsule => {
            // The caps are two hemispheres, each with its centre of mass half a radius beyond an end of the cylinder.
            let side = 2.0 * PI * r * h;
            let caps = 4.0 * PI * r * r;
            let along = (side * r * r + caps * 2.0 / 3.0 * r * r) / (side + caps);
            let far = 0.5 * h;
            let across = (side * (0.5 * r * r + h * h / 12.0) + caps * (2.0 / 3.0 * r * r + far * far + far * r))
                / (side + caps);
            Some((side + caps, Vector3::new(across, across, along)))
        }
        _ => None,
    }
}

impl Mesh {
    /// Mass, centre of mass and inertia of the mesh at a density of 1 kg/m^3, or for a shell 1 kg/m^2.
    pub fn weighed(&self) -> Result<BodyInertia, String> {
        let (vertices, faces) = self.triangles()?;
        properties(&vertices, &faces, self.mass_kind()?)
            .ok_or_else(|| format!("mesh `{}` has no volume; write inertia=\"shell\" at the <mesh>", self.name))
    }

    fn mass_kind(&self) -> Result<MassOf, String> {
        match self.inertia.as_str() {
            "legacy" => Ok(MassOf::Pyramids),
            "exact" => Ok(MassOf::Volume),
            "convex" => Ok(MassOf::Hull),
            "shell" => Ok(MassOf::Surface),
            other => {
                Err(format!("mesh `{}`: inertia=\"{other}\": it is one of convex, exact, legacy, shell", self.name))
            }
        }
    }
}
