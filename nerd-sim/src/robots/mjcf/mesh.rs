//! Mesh assets of an MJCF: paths of their files, and their triangles.

use nerd_core::robot::Form;

use super::element::Element;
use super::model::{Mesh, Model};
use super::scope::Scope;
use crate::internal::*;

/// All meshes of a file.
pub(super) fn meshes(root: &Element, scope: &Scope) -> Result<Vec<Mesh>, UrdfError> {
    root.all("asset").flat_map(|asset| asset.all("mesh")).map(|e| mesh(e, scope)).collect()
}

fn mesh(e: &Element, scope: &Scope) -> Result<Mesh, UrdfError> {
    let mut class = scope.source.classes.of(e, None)?.mesh.clone();
    class.apply(e)?;
    let (file, name) = scope.asset(e)?;
    if file.is_none() && !e.has("vertex") {
        return Err(e.refused("it has neither file nor vertex; builtin meshes are not supported"));
    }
    let vertices = e.list("vertex")?.filter(|_| file.is_none()).unwrap_or_default();
    let indices = e.list("face")?.filter(|_| file.is_none()).unwrap_or_default();
    let count = vertices.len() / 3;
    if vertices.len() % 3 != 0
        || indices.len() % 3 != 0
        || indices.iter().any(|k| !(0.0..count as f64).contains(k) || k.fract() != 0.0)
    {
        return Err(e.refused("vertex needs three numbers each, face three indices of them"));
    }
    let mut reference = Isometry3::identity();
    if let Some(at) = e.array::<3>("refpos")? {
        reference.translation = Vector3::from(at).into();
    }
    if let Some([w, x, y, z]) = e.array("refquat")? {
        let quat = nalgebra::Quaternion::new(w, x, y, z);
        reference.rotation = UnitQuaternion::try_new(quat, 1e-12).ok_or_else(|| e.refused("refquat is zero"))?;
    }
    Ok(Mesh {
        name,
        file,
        // MuJoCo stores vertices in 32 bits.
        vertices: vertices.chunks(3).map(|v| Vector3::from_column_slice(v).map(|x| f64::from(x as f32))).collect(),
        faces: indices.chunks(3).map(|face| [face[0] as u32, face[1] as u32, face[2] as u32]).collect(),
        scale: class.scale.into(),
        reference,
        inertia: class.inertia,
    })
}

/// Vertices (m) and triangles.
type Triangles = (Vec<Vector3<f64>>, Vec<[u32; 3]>);

impl Mesh {
    /// Vertices (m) and triangles of the mesh: moved into the reference frame, then scaled.
    pub fn triangles(&self) -> Result<Triangles, String> {
        let (mut vertices, mut faces) = match &self.file {
            Some(file) => read(file).map_err(|reason| format!("mesh `{}`, {}: {reason}", self.name, file.display()))?,
            None => (self.vertices.clone(), self.faces.clone()),
        };
        vertices
            .iter_mut()
            .for_each(|v| *v = self.reference.inverse_transform_point(&(*v).into()).coords.component_mul(&self.scale));
        if self.scale.product() < 0.0 {
            faces.iter_mut().for_each(|face| face.swap(1, 2));
        }
        Ok((vertices, faces))
    }

    /// Form and pose of a geom with this mesh at `pose`; `None` for an unreadable file.
    pub fn form(&self, pose: &Isometry3<f64>) -> Option<(Form, Isometry3<f64>)> {
        let [x, y, z] = self.scale.into();
        let turns = self.reference.rotation.angle() > 0.0 && !(x == y && y == z);
        match &self.file {
            // Without a rotation of the reference frame, or with uniform scale, scaling first and moving then gives the
            // same solid.
            Some(file) if !turns => {
                let back = self.reference.rotation.inverse();
                let at = -(back * self.reference.translation.vector).component_mul(&self.scale);
                // An absolute path: the reader would join a relative path to the folder of the robot's file a second
                // time.
                let file = std::path::absolute(file).unwrap_or_else(|_| file.clone());
                let form = Form::Mesh { file: file.to_string_lossy().into_owned(), scale: self.scale };
                Some((form, pose * Isometry3::from_parts(at.into(), back)))
            }
            _ => Some((Form::Hull(self.triangles().ok()?.0), *pose)),
        }
    }
}

impl Model {
    pub fn mesh(&self, name: &str) -> Option<&Mesh> {
        self.meshes.iter().find(|mesh| mesh.name == name)
    }
}

#[cfg(feature = "meshes")]
fn read(file: &Path) -> Result<Triangles, String> {
    crate::robots::mesh::triangles(file)
}

#[cfg(not(feature = "meshes"))]
fn read(_: &Path) -> Result<Triangles, String> {
    Err("this build reads no mesh files; switch the feature `meshes` on, or give the body an <inertial>".into())
}
