//! Reads the vertices of a glTF 2.0 file (crate gltf), with the transforms of the nodes. Formats are text (.gltf,
//! buffers inside or in separate files) and binary (.glb). Units are metres; y is not rotated up, as in other readers
//! of URDF.

use base64::{Engine, prelude::BASE64_STANDARD};
use gltf::{Gltf, Mesh, Node, buffer::Source};
use nalgebra::{Matrix4, Point3};

use crate::internal::*;
use crate::robots::mesh::file::{MAX_DEPTH, MAX_FILE_SIZE, MAX_NODES, MAX_VERTICES, bytes_of};

/// The vertices (m); buffers are found relative to `path`, the file.
pub(super) fn vertices(bytes: &[u8], path: &Path) -> Result<Vec<Vector3<f64>>, String> {
    let Gltf { document, mut blob } =
        Gltf::from_slice(bytes).map_err(|e| format!("is no glTF that can be read: {e}"))?;
    let buffers = document.buffers().map(|buffer| match buffer.source() {
        Source::Bin => blob.take().ok_or("a binary buffer is missing".to_string()),
        Source::Uri(uri) => match uri.split_once(";base64,") {
            Some((_, text)) => BASE64_STANDARD.decode(text).map_err(|e| format!("buffer {}: {e}", buffer.index())),
            None => bytes_of(&path.with_file_name(uri.replace("%20", " "))).map_err(|e| format!("buffer {uri}: {e}")),
        },
    });
    let mut whole = 0;
    let borne = buffers.take_while(|buffer: &Result<Vec<u8>, String>| {
        whole += buffer.as_ref().map_or(0, Vec::len) as u64;
        whole <= MAX_FILE_SIZE
    });
    let mut file = File { buffers: borne.collect::<Result<_, _>>()?, seen: 0, found: Vec::new() };
    match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => scene.nodes().try_for_each(|node| file.node(&node, Matrix4::identity(), 0))?,
        None => document.meshes().try_for_each(|mesh| file.mesh(&mesh, &Matrix4::identity()))?,
    }
    Ok(file.found)
}

struct File {
    buffers: Vec<Vec<u8>>,
    seen: usize,
    found: Vec<Vector3<f64>>,
}

impl File {
    fn node(&mut self, node: &Node, place: Matrix4<f64>, depth: usize) -> Result<(), String> {
        self.seen += 1;
        if depth > MAX_DEPTH || self.seen > MAX_NODES {
            return Err(format!("nodes nested more than {MAX_DEPTH} deep, or more than {MAX_NODES} of them"));
        }
        let place = place * Matrix4::from(node.transform().matrix()).cast::<f64>();
        node.mesh().map_or(Ok(()), |mesh| self.mesh(&mesh, &place))?;
        node.children().try_for_each(|child| self.node(&child, place, depth + 1))
    }

    fn mesh(&mut self, mesh: &Mesh, place: &Matrix4<f64>) -> Result<(), String> {
        for primitive in mesh.primitives() {
            // Check the count before reading: a short file may state any number of vertices.
            let count = primitive.get(&gltf::Semantic::Positions).map_or(0, |accessor| accessor.count());
            if count > MAX_VERTICES - self.found.len() {
                return Err(format!("more than {MAX_VERTICES} vertices"));
            }
            let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(Vec::as_slice));
            let missing = || format!("mesh {}: its positions are not in its buffers", mesh.index());
            let positions = reader.read_positions().ok_or_else(missing)?;
            self.found.extend(positions.map(|p| place.transform_point(&Point3::from(p.map(f64::from))).coords));
        }
        Ok(())
    }
}
