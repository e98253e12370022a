//! Reads the vertices of a COLLADA file, with the transforms of the nodes, as needed for a convex hull. `<up_axis>` is
//! ignored, as in other readers of URDF.

use std::collections::HashMap;

use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};
use roxmltree::Node;

use super::xml::document;
use crate::robots::mesh::file::{MAX_DEPTH, MAX_NODES, MAX_VERTICES};

/// The vertices (m).
pub(super) fn vertices(text: &str) -> Result<Vec<Vector3<f64>>, String> {
    let document = document(text)?;
    let unit = document.descendants().find(|n| n.tag_name().name() == "unit");
    let unit = unit.and_then(|n| n.attribute("meter")?.parse::<f64>().ok()).unwrap_or(1.0);
    let ids = document.descendants().filter_map(|n| Some((n.attribute("id")?, n))).collect();
    let mut file = File { ids, seen: 0, found: Vec::new() };
    let place = Matrix4::new_scaling(unit);
    match document.descendants().find(|n| n.tag_name().name() == "instance_visual_scene") {
        Some(instance) => {
            let scene = file.target(&instance, "url")?;
            file.node(&scene, place, 0)?;
        }
        None => {
            for geometry in document.descendants().filter(|n| n.tag_name().name() == "geometry") {
                file.geometry(&geometry, &place)?;
            }
        }
    }
    Ok(file.found)
}

struct File<'a> {
    ids: HashMap<&'a str, Node<'a, 'a>>,
    seen: usize,
    found: Vec<Vector3<f64>>,
}

impl<'a> File<'a> {
    /// The target of a reference such as `url="#id"`.
    fn target(&self, node: &Node, key: &str) -> Result<Node<'a, 'a>, String> {
        let id = node.attribute(key).unwrap_or_default().trim_start_matches('#');
        self.ids
            .get(id)
            .copied()
            .ok_or_else(|| format!("<{}> points to `{id}`, which is not there", node.tag_name().name()))
    }

    /// Reads a node or scene; `place` is the transform of its parent nodes.
    fn node(&mut self, node: &Node<'a, 'a>, mut place: Matrix4<f64>, depth: usize) -> Result<(), String> {
        if depth > MAX_DEPTH {
            return Err(format!("nodes nested more than {MAX_DEPTH} deep"));
        }
        for child in node.children().filter(Node::is_element) {
            self.seen += 1;
            if self.seen > MAX_NODES {
                return Err(format!("nodes that show more than {MAX_NODES} elements"));
            }
            match child.tag_name().name() {
                "matrix" => place *= Matrix4::from_row_slice(&numbers::<16>(&child)?),
                "translate" => place *= Matrix4::new_translation(&numbers::<3>(&child)?.into()),
                "scale" => place *= Matrix4::new_nonuniform_scaling(&numbers::<3>(&child)?.into()),
                "rotate" => {
                    let [x, y, z, degrees] = numbers(&child)?;
                    let axis = Unit::try_new(Vector3::new(x, y, z), 1e-12).ok_or("<rotate> without an axis")?;
                    place *= Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous();
                }
                "lookat" | "skew" => return Err(format!("<{}> is not read", child.tag_name().name())),
                "instance_geometry" => self.geometry(&self.target(&child, "url")?, &place)?,
                "instance_controller" => {
                    let skin = self.target(&child, "url")?.children().find(|n| n.tag_name().name() == "skin");
                    self.geometry(&self.target(&skin.ok_or("a controller without <skin>")?, "source")?, &place)?;
                }
                "instance_node" => self.node(&self.target(&child, "url")?, place, depth + 1)?,
                "node" => self.node(&child, place, depth + 1)?,
                _ => {}
            }
        }
        Ok(())
    }

    fn geometry(&mut self, geometry: &Node<'a, 'a>, place: &Matrix4<f64>) -> Result<(), String> {
        let inputs = geometry.descendants().filter(|n| n.tag_name().name() == "vertices").flat_map(|n| n.children());
        for input in inputs.filter(|n| n.attribute("semantic") == Some("POSITION")) {
            let source = self.target(&input, "source")?;
            let floats = source
                .children()
                .find(|n| n.tag_name().name() == "float_array")
                .ok_or("a source without <float_array>")?;
            let accessor = source.descendants().find(|n| n.tag_name().name() == "accessor");
            let stride = accessor.and_then(|n| n.attribute("stride")?.parse().ok()).unwrap_or(3).max(3);
            let floats =
                floats.text().unwrap_or_default().split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>();
            let floats = floats.map_err(|_| "<float_array> with a word that is not a number")?;
            self.found.extend(
                floats.chunks_exact(stride).map(|p| place.transform_point(&Point3::new(p[0], p[1], p[2])).coords),
            );
            if self.found.len() > MAX_VERTICES {
                return Err(format!("more than {MAX_VERTICES} vertices"));
            }
        }
        Ok(())
    }
}

fn numbers<const N: usize>(node: &Node) -> Result<[f64; N], String> {
    let words = node.text().unwrap_or_default().split_whitespace().map(str::parse::<f64>);
    let numbers = words.collect::<Result<Vec<f64>, _>>().ok().and_then(|all| all.try_into().ok());
    numbers.ok_or_else(|| format!("<{}> needs {N} numbers", node.tag_name().name()))
}
