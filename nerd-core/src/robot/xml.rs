//! Preprocessing of a URDF's text for urdf-rs.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::words::check;

/// Elements of a URDF may be nested this deep; urdf-rs recurses and would overflow the stack far beyond it.
const DEEPEST: usize = 64;

/// The text without its <material> elements: nothing here looks at what things look like, and files leave them unfinished,
/// which urdf-rs minds. Refuses a text that is not well-formed, nested too deep, or misspelt where it matters.
pub(super) fn without_materials(text: &str) -> Result<String, String> {
    let mut reader = Reader::from_str(text);
    let (mut out, mut depth) = (String::with_capacity(text.len()), 0usize);
    let mut path: Vec<String> = Vec::new();
    // Depth of the <material> that is being skipped.
    let mut left_out = None;
    loop {
        let start = reader.buffer_position() as usize;
        let event = reader.read_event().map_err(|e| format!("{e} (byte {})", reader.error_position()))?;
        let end = reader.buffer_position() as usize;
        let mut kept = left_out.is_none();
        match event {
            Event::Eof if depth > 0 => return Err("the text ends within an element".into()),
            Event::Eof => return Ok(out),
            Event::Start(tag) => {
                depth += 1;
                if depth > DEEPEST {
                    return Err(format!("elements nested more than {DEEPEST} deep"));
                }
                path.push(name(&tag));
                check(&path, attributes(&tag))?;
                if kept && tag.name().as_ref() == b"material" {
                    (left_out, kept) = (Some(depth), false);
                }
            }
            Event::Empty(tag) => {
                path.push(name(&tag));
                check(&path, attributes(&tag))?;
                path.pop();
                kept &= tag.name().as_ref() != b"material";
            }
            Event::End(_) => {
                path.pop();
                left_out = left_out.filter(|at| *at != depth);
                depth -= 1;
            }
            _ => {}
        }
        if kept {
            out += text.get(start..end).unwrap_or_default();
        }
    }
}

fn name(tag: &BytesStart) -> String {
    String::from_utf8_lossy(tag.name().as_ref()).into_owned()
}

fn attributes(tag: &BytesStart) -> impl Iterator<Item = String> {
    let names: Vec<String> = tag.attributes().flatten().map(|a| String::from_utf8_lossy(a.key.as_ref()).into_owned()).collect();
    names.into_iter()
}
