//! Reads triangles of mesh files for mass properties: STL, OBJ and MuJoCo's MSH.

use super::file::{MAX_VERTICES, bytes_of};
use crate::internal::*;

/// Vertices and triangles.
type Triangles = (Vec<Vector3<f64>>, Vec<[u32; 3]>);

/// Vertices (in the file's own unit) and triangles of a file, neither scaled nor merged.
pub(crate) fn triangles(path: &Path) -> Result<Triangles, String> {
    let bytes = bytes_of(path)?;
    let read = std::panic::catch_unwind(|| {
        match path.extension().unwrap_or_default().to_string_lossy().to_lowercase().as_str() {
            "stl" => stl(bytes),
            "obj" => obj(&String::from_utf8_lossy(&bytes)),
            "msh" => msh(&bytes),
            other => Err(format!("triangles of a .{other} are not read; STL, OBJ and MSH are")),
        }
    });
    let (vertices, faces) = read.map_err(|_| "cannot be read".to_string())??;
    let sound = vertices.iter().all(|v| v.iter().all(|x| x.abs() < 1e9))
        && faces.iter().flatten().all(|k| (*k as usize) < vertices.len());
    if sound { Ok((vertices, faces)) } else { Err("has a vertex that is not finite, or a face without one".into()) }
}

/// Vertices and triangles of an STL.
pub(crate) fn stl(mut bytes: Vec<u8>) -> Result<Triangles, String> {
    // Binary STL may begin with the keyword of text STL; the file length decides.
    let count = bytes.get(80..84).and_then(|n| n.try_into().ok()).map_or(0, u32::from_le_bytes);
    if bytes.len() as u64 == 84 + 50 * u64::from(count) {
        bytes[..80].fill(0);
    }
    let scene = mesh_loader::stl::from_slice(&bytes).map_err(|e| e.to_string())?;
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for mesh in &scene.meshes {
        let first = vertices.len() as u32;
        vertices.extend(mesh.vertices.iter().map(|v| Vector3::from(v.map(f64::from))));
        faces.extend(mesh.faces.iter().map(|face| face.map(|k| k + first)));
    }
    Ok((vertices, faces))
}

/// Positions are rounded to 32 bits, as in MuJoCo. A quadrilateral is cut along its shorter diagonal, a larger polygon
/// becomes a fan.
fn obj(text: &str) -> Result<Triangles, String> {
    let mut vertices = Vec::<Vector3<f64>>::new();
    let mut faces = Vec::new();
    for (n, line) in text.lines().enumerate() {
        let wrong = || format!("line {}: cannot be read", n + 1);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let xyz: Vec<f64> =
                    words.take(3).filter_map(|x| x.parse::<f64>().ok()).map(|x| f64::from(x as f32)).collect();
                vertices.push((xyz.len() == 3).then(|| Vector3::from_column_slice(&xyz)).ok_or_else(wrong)?);
            }
            Some("f") => {
                let count = vertices.len() as i64;
                let corner = |word: &str| {
                    let k = word.split('/').next().and_then(|k| k.parse::<i64>().ok())?;
                    let k = if k < 0 { count + k } else { k - 1 };
                    u32::try_from(k).ok()
                };
                let mut corners =
                    words.map(corner).collect::<Option<Vec<_>>>().filter(|c| c.len() >= 3).ok_or_else(wrong)?;
                let far = |a: u32, b: u32| Some((vertices.get(a as usize)? - vertices.get(b as usize)?).norm_squared());
                if let [a, b, c, d] = corners[..]
                    && far(a, c) >= far(b, d)
                {
                    corners = vec![b, c, d, a];
                }
                faces.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
            }
            _ => {}
        }
        if faces.len() > MAX_VERTICES || vertices.len() > MAX_VERTICES {
            return Err(format!("more than {MAX_VERTICES} faces or vertices"));
        }
    }
    Ok((vertices, faces))
}

/// MSH: numbers of vertices, normals, texture coordinates and faces, then the data in this order.
fn msh(bytes: &[u8]) -> Result<Triangles, String> {
    let word = |k: usize| bytes.get(4 * k..4 * k + 4).and_then(|b| b.try_into().ok());
    let count =
        |k: usize| word(k).map(i32::from_le_bytes).and_then(|n| usize::try_from(n).ok()).filter(|n| *n <= MAX_VERTICES);
    let [Some(vertices), Some(normals), Some(textures), Some(faces)] = [0, 1, 2, 3].map(count) else {
        return Err("is no MSH that can be read".into());
    };
    let first = 4 + 3 * vertices + 3 * normals + 2 * textures;
    if bytes.len() != 4 * (first + 3 * faces) {
        return Err("is no MSH that can be read: its length is not that of what it says it holds".into());
    }
    let real = |k: usize| word(k).map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b)));
    let index = |k: usize| word(k).map_or(u32::MAX, u32::from_le_bytes);
    let vertices = (0..vertices).map(|i| Vector3::new(real(4 + 3 * i), real(5 + 3 * i), real(6 + 3 * i)));
    let faces = (0..faces).map(|i| [0, 1, 2].map(|k| index(first + 3 * i + k)));
    Ok((vertices.collect(), faces.collect()))
}
