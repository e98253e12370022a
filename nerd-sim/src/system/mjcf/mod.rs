//! Robots read from MJCF, MuJoCo's own text.
//!
//! A file becomes elements ([`parse`]), with the names and attributes of MuJoCo's schema. Elements with their default classes become a
//! model, in SI units and with frames, copies and attached models expanded. The model becomes bodies, as a URDF does, and keys of a
//! specification. A joint's coordinate is MuJoCo's own, `ref` included; a link's frame is its last joint's, and it also stores the body's.
//! Equalities of joints hold exactly ([`nerd_core::robot::Mimic`]), limits follow our law, contacts ours with the friction, filters and
//! margins of the file.

mod actuator;
mod attach;
mod bodies;
mod classes;
mod compiler;
mod contacts;
mod describe;
mod description;
mod drives;
mod element;
mod field;
mod fit;
mod geom;
mod inertia;
mod joint;
mod keys;
mod law;
mod mesh;
mod model;
mod names;
mod option;
mod parse;
mod placement;
mod read;
mod robot;
mod schema;
mod scope;
mod shapes;
mod site;
mod source;
mod statics;
mod texture;
mod tree;
mod values;
mod volume;

pub(crate) use description::Description;
pub use parse::is_mjcf;
pub(crate) use statics::Static;
