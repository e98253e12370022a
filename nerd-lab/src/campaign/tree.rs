//! Random edits of XML by element and attribute: delete, duplicate, swap, rename, nest, and set extreme values.

use rand::RngExt;

use super::text::Dice;
use crate::prelude::*;

/// Largest file, in elements, to which edits still add copies of elements.
const MOST: usize = 400;
/// Unusual values that edits give to attributes.
const ODD: [&str; 14] = [
    "0",
    "-1",
    "1e300",
    "-1e300",
    "nan",
    "inf",
    "",
    "1e-300",
    "x",
    "0.5 0.5",
    "1 0 0 0 0 0 0",
    "true",
    "3",
    "2147483648",
];

#[derive(Clone)]
pub struct Element {
    pub name: String,
    pub attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
}

impl Element {
    /// Parses XML into its root element; text nodes are dropped.
    pub fn read(text: &str) -> Result<Self> {
        fn of(node: roxmltree::Node) -> Element {
            Element {
                name: node.tag_name().name().into(),
                attributes: node.attributes().map(|a| (a.name().into(), a.value().into())).collect(),
                children: node.children().filter(|n| n.is_element()).map(of).collect(),
            }
        }
        Ok(of(roxmltree::Document::parse(text)?.root_element()))
    }

    pub fn write(&self, out: &mut String) {
        let escape = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
        out.push_str(&format!("<{}", self.name));
        self.attributes.iter().for_each(|(key, value)| out.push_str(&format!(" {key}=\"{}\"", escape(value))));
        if self.children.is_empty() {
            return out.push_str("/>");
        }
        out.push('>');
        self.children.iter().for_each(|child| child.write(out));
        out.push_str(&format!("</{}>", self.name));
    }

    fn count(&self) -> usize {
        1 + self.children.iter().map(Self::count).sum::<usize>()
    }

    /// Returns the k-th element below this one in depth-first order; 0 is this element.
    fn at(&mut self, mut k: usize) -> &mut Self {
        let Some(next) = k.checked_sub(1) else { return self };
        k = next;
        let sizes = self.children.iter().map(Self::count).collect_vec();
        for (child, size) in sizes.into_iter().enumerate() {
            if k < size {
                return self.children[child].at(k);
            }
            k -= size;
        }
        self
    }

    /// This element and all below it, in depth-first order.
    pub fn all(&self) -> Vec<&Self> {
        std::iter::once(self).chain(self.children.iter().flat_map(Self::all)).collect()
    }

    /// Makes one random edit; `others` are elements of valid files of the same kind.
    pub fn change(&mut self, dice: &mut Dice, others: &[Self]) {
        let n = self.count();
        let [a, b] = [(); 2].map(|()| dice.random_range(0..n));
        let other = others[dice.random_range(0..others.len())].clone();
        match dice.random_range(0..16) {
            0 => self.thin(dice, a, |_| Vec::new()),
            1 if n < MOST => self.thin(dice, a, |child| vec![child.clone(), child]),
            2 => {
                let own = self.at(a);
                let m = own.children.len();
                if m > 1 {
                    let [x, y] = [(); 2].map(|()| dice.random_range(0..m));
                    own.children.swap(x, y);
                }
            }
            // Copies one element into the children of another.
            3 if n < MOST => {
                let moved = self.at(a).clone();
                self.at(b).children.push(moved);
            }
            4 if n < MOST => self.at(a).children.push(Self { children: Vec::new(), ..other }),
            5 => self.at(a).name = other.name,
            6 => self.at(a).children.reverse(),
            7 => {
                let own = self.at(a);
                if !own.attributes.is_empty() {
                    let k = dice.random_range(0..own.attributes.len());
                    own.attributes.remove(k);
                }
            }
            8 | 9 => {
                if !other.attributes.is_empty() {
                    let (key, value) = other.attributes[dice.random_range(0..other.attributes.len())].clone();
                    self.at(a).set(key, value);
                }
            }
            // Renames an attribute to another element's key and keeps the value.
            10 => {
                let own = self.at(a);
                if let (Some((key, _)), false) = (other.attributes.first(), own.attributes.is_empty()) {
                    let k = dice.random_range(0..own.attributes.len());
                    let value = own.attributes.remove(k).1;
                    own.set(key.clone(), value);
                }
            }
            _ => {
                // Changes an attribute's value in the next element that has attributes.
                if let Some(own) = (a..n).chain(0..a).find(|k| !self.at(*k).attributes.is_empty()) {
                    let own = self.at(own);
                    let k = dice.random_range(0..own.attributes.len());
                    own.attributes[k].1 = value(dice, &own.attributes[k].1);
                }
            }
        }
    }

    fn set(&mut self, key: String, value: String) {
        match self.attributes.iter_mut().find(|own| own.0 == key) {
            Some(own) => own.1 = value,
            None => self.attributes.push((key, value)),
        }
    }

    /// Replaces a random child of an element by the elements that `of` returns.
    fn thin(&mut self, dice: &mut Dice, at: usize, of: impl Fn(Self) -> Vec<Self>) {
        let own = self.at(at);
        if !own.children.is_empty() {
            let k = dice.random_range(0..own.children.len());
            let child = own.children.remove(k);
            own.children.splice(k..k, of(child));
        }
    }
}

/// Returns an attribute's value `text` with one word changed, or replaced as a whole.
fn value(dice: &mut Dice, text: &str) -> String {
    let odd = ODD[dice.random_range(0..ODD.len())];
    let mut words = text.split_whitespace().map(String::from).collect_vec();
    match dice.random_range(0..10) {
        0 => "1 ".repeat(3000),
        1 => text.repeat(2),
        2 => odd.into(),
        _ if words.is_empty() => odd.into(),
        draw => {
            let k = dice.random_range(0..words.len());
            words[k] = match words[k].parse::<f64>() {
                Ok(x) if draw < 6 => (x * 10f64.powf(dice.random_range(-3.0..3.0))).to_string(),
                Ok(x) if draw == 6 => (-x).to_string(),
                _ => odd.into(),
            };
            words.join(" ")
        }
    }
}
