//! Reads robots from MJCF, MuJoCo's model format.
//!
//! A file is parsed into elements ([`parse`]) with the names and attributes of MuJoCo's schema. Elements and default
//! classes become a model in SI units, with frames, replicas and attached models expanded. The model is converted to
//! bodies, as a URDF is, and to keys of a specification. Joint coordinates equal MuJoCo's, including the offset `ref`.
//! The frame of a link lies at the body's last joint; the MJCF's frame of the body is stored, too. Joint equalities
//! hold exactly ([`nerd_core::robot::Mimic`]). Joint limits follow the law of this crate, not MuJoCo's. Contacts, too,
//! but with the file's friction, filters and margins.

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
