//! Fusion's tool libraries: `{"data": [tool, …]}`, each tool with its type, its unit, its geometry under the short names of
//! ISO 13399, and its holder.
//!
//! ```text
//! DC  cutting diameter        LCF  length of the edges          LB    from the tip to the holder's face
//! RE  corner radius           TA   taper in degrees a side      SFDM  shaft's diameter
//! SIG point's whole angle     OAL length from end to end
//! shoulder-length, shoulder-diameter: between the edges and the shaft
//! ```
//! The shaft's own segments, where there are any, begin at the shoulder's end; `SFDM` reaches from there or from them to the
//! holder. Holders have a unit of their own; their segments stand from the face upwards.

use std::borrow::Cow;
use std::io::Read as _;

use serde::Deserialize;
use serde_json::Value;

use super::{Fault, Stack, damaged, end_mill, line, no_choice, pointed, refused, top};
use crate::tool::{Segment, SharpPoints, Tool};
use crate::unit::LengthUnit;

#[derive(Deserialize)]
struct Library {
    data: Vec<Entry>,
}

#[derive(Deserialize)]
struct Entry {
    #[serde(default, rename = "type")]
    kind: String,
    #[serde(default)]
    unit: Option<String>,
    #[serde(default)]
    description: String,
    #[serde(default, rename = "product-id")]
    product: String,
    #[serde(default)]
    geometry: serde_json::Map<String, Value>,
    #[serde(default)]
    shaft: Option<Segments>,
    #[serde(default)]
    holder: Option<Segments>,
    #[serde(default, rename = "post-process")]
    post: Option<Post>,
}

#[derive(Deserialize)]
struct Segments {
    #[serde(default)]
    unit: Option<String>,
    #[serde(default)]
    segments: Vec<Part>,
}

#[derive(Deserialize)]
struct Part {
    height: f64,
    #[serde(rename = "lower-diameter")]
    lower: f64,
    #[serde(rename = "upper-diameter")]
    upper: f64,
}

#[derive(Deserialize)]
struct Post {
    #[serde(default)]
    number: Option<Value>,
}

/// The most bytes that an archive may unfold to, for each of its own.
const MAX_UNFOLDING: u64 = 200;

/// The tool of a `.json` or `.tools` file that `wanted` names, or its only one.
pub(super) fn tool(bytes: &[u8], wanted: Option<&str>) -> Result<Tool, Fault> {
    let entries = entries(bytes)?;
    let tools: Vec<&Entry> = entries.iter().collect();
    let found: Vec<&Entry> = match wanted.map(str::trim) {
        Some("") => Vec::new(),
        Some(wanted) => tools.iter().copied().filter(|entry| entry.answers_to(wanted)).collect(),
        None => tools.clone(),
    };
    let &[entry] = found.as_slice() else {
        let what = match wanted {
            None => format!("it holds {} tools; name one, as in FILE#NAME", found.len()),
            Some(wanted) if wanted.trim().is_empty() => super::NAMELESS.into(),
            Some(wanted) if found.is_empty() => format!("no tool of it is called '{wanted}'"),
            Some(wanted) => format!("{} tools of it are called '{wanted}'", found.len()),
        };
        let titles: Vec<String> = tools.iter().map(|entry| entry.title()).collect();
        return Err(no_choice(&what, &titles));
    };
    entry.tool()
}

/// All tools of a `.json` or `.tools` file.
pub(super) fn tools(bytes: &[u8]) -> Result<Vec<Result<Tool, Fault>>, Fault> {
    Ok(entries(bytes)?.iter().map(Entry::tool).collect())
}

/// The entries that are tools.
fn entries(bytes: &[u8]) -> Result<Vec<Entry>, Fault> {
    let text = if bytes.starts_with(b"PK") {
        Cow::Owned(unpacked_json(bytes).map_err(damaged)?)
    } else {
        Cow::Borrowed(bytes)
    };
    let mut library: Library =
        serde_json::from_slice(text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text)).map_err(damaged)?;
    library.data.retain(|entry| entry.kind != "holder");
    Ok(library.data)
}

/// The JSON inside a `.tools` archive.
fn unpacked_json(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let name = {
        let mut names = archive.file_names().filter_map(Result::ok);
        names.find(|name| name.to_lowercase().ends_with(".json")).map(Cow::into_owned)
    };
    let name = name.ok_or("the archive holds no JSON")?;
    let file = archive.by_name(&name).map_err(|e| e.to_string())?;
    let mut text = Vec::new();
    let most = bytes.len() as u64 * MAX_UNFOLDING;
    file.take(most + 1).read_to_end(&mut text).map_err(|e| e.to_string())?;
    if text.len() as u64 > most {
        return Err(format!("{name} unfolds to more than {MAX_UNFOLDING} times the file"));
    }
    Ok(text)
}

/// The unit that a text names.
fn unit(text: &str) -> Result<LengthUnit, String> {
    text.parse().map_err(|_| format!("its unit '{text}' is not known"))
}

impl Entry {
    /// What people call it.
    fn title(&self) -> String {
        match (self.description.trim(), self.number()) {
            ("", Some(number)) => number,
            ("", None) => self.product.clone(),
            (name, _) => name.to_owned(),
        }
    }

    /// Its number in the machine.
    fn number(&self) -> Option<String> {
        let number = self.post.as_ref()?.number.as_ref()?;
        Some(number.as_str().map_or_else(|| number.to_string(), str::to_owned))
    }

    fn answers_to(&self, wanted: &str) -> bool {
        let same = |name: &str| name.trim().eq_ignore_ascii_case(wanted);
        same(&self.description) || same(&self.product) || self.number().is_some_and(|number| same(&number))
    }

    fn tool(&self) -> Result<Tool, Fault> {
        let (name, sharp_points) = (self.title(), SharpPoints::Tip);
        let (unit, stack) = self.stack().map_err(|what| refused(&name, &what))?;
        // A library that states none has 0.
        let overall_length =
            self.number_of("OAL").map_err(|what| refused(&name, &what))?.filter(|&l| l > 0.0);
        Ok(Tool { name, unit, shape: stack.shape(), sharp_points, overall_length, back_cutting: false })
    }

    /// The unit that the entry states, and its parts in it.
    fn stack(&self) -> Result<(LengthUnit, Stack), String> {
        let named = self.unit.as_deref().ok_or("it has no unit")?;
        let unit_here = unit(named)?;
        let (radius, edges) = (0.5 * self.positive("DC")?, self.positive("LCF")?);
        let face = self.positive("LB")?;
        let cutter = self.cutter(radius, edges)?;
        let width = cutter.last().map_or(radius, |last| last.radius(top(&cutter)));
        let shank = self.shank(top(&cutter), width, face)?;
        let mut holder = Vec::new();
        if let Some(Segments { unit: named, segments }) = &self.holder {
            let theirs = named.as_deref().map_or(Ok(unit_here), unit)?;
            let scale = theirs.in_mm() / unit_here.in_mm();
            for part in segments {
                holder.push(part.checked("the holder")?.map(|length| length * scale));
            }
        }
        holder.retain(|[height, ..]| *height > 0.0);
        let face = if holder.is_empty() { face.min(top(&shank).max(top(&cutter))) } else { face };
        Ok((unit_here, Stack { cutter, shank, face, holder }))
    }

    fn cutter(&self, radius: f64, edges: f64) -> Result<Vec<Segment>, String> {
        let taper = || self.number_of("TA").map(|angle| angle.unwrap_or(0.0));
        let corner = || self.number_of("RE").map(|corner| corner.unwrap_or(0.0));
        let tip = || self.number_of("tip-diameter").map(|tip| 0.5 * tip.unwrap_or(0.0));
        match self.kind.as_str() {
            "flat end mill" | "reamer" => end_mill(radius, 0.0, 0.0, edges),
            "face mill" => match self.number_of("DCX")? {
                Some(widest) if widest > 2.0 * radius * (1.0 + 1e-9) => Err(format!(
                    "a face mill whose inserts widen it (DCX {widest}) has no place among our cutters"
                )),
                _ => end_mill(radius, corner()?, 0.0, edges),
            },
            "ball end mill" => end_mill(radius, radius, 0.0, edges),
            "bull nose end mill" => end_mill(radius, corner()?, 0.0, edges),
            "tapered mill" => end_mill(radius, corner()?, taper()?, edges),
            "chamfer mill" => pointed(tip()?, radius, taper()?, edges),
            "drill" | "spot drill" => pointed(0.0, radius, 0.5 * self.positive("SIG")?, edges),
            "counter sink" => pointed(tip()?, radius, 0.5 * self.positive("SIG")?, edges),
            "" => Err("it has no type".into()),
            other => Err(format!("its type '{other}' has no place among our cutters")),
        }
    }

    /// Shoulder, shaft's segments and shaft, from the edges' end, where the cutter has `radius`, to the holder.
    fn shank(&self, edges: f64, radius: f64, face: f64) -> Result<Vec<Segment>, String> {
        let mut profile = Vec::new();
        let mut from = edges;
        let mut rise = |to: f64, lower: f64, upper: f64, from: &mut f64| {
            if to > *from {
                profile.push(line(*from, to, lower, upper));
                *from = to;
            }
        };
        if let Some(shoulder) = self.number_of("shoulder-length")? {
            let width = self.number_of("shoulder-diameter")?.filter(|&width| width > 0.0);
            let width = width.map_or(radius, |width| 0.5 * width);
            rise(shoulder, width, width, &mut from);
        }
        for part in self.shaft.iter().flat_map(|shaft| &shaft.segments) {
            let [height, lower, upper] = part.checked("the shaft")?;
            rise(from + height, 0.5 * lower, 0.5 * upper, &mut from);
        }
        if face > from {
            let shaft = 0.5 * self.positive("SFDM")?;
            rise(face, shaft, shaft, &mut from);
        }
        Ok(profile)
    }

    /// A number of the geometry that is finite and not negative.
    fn number_of(&self, name: &str) -> Result<Option<f64>, String> {
        match self.geometry.get(name) {
            None | Some(Value::Null) => Ok(None),
            Some(value) => match value.as_f64() {
                Some(number) if number.is_finite() && number >= 0.0 => Ok(Some(number)),
                _ => Err(format!("its geometry's {name} is {value}")),
            },
        }
    }

    fn positive(&self, name: &str) -> Result<f64, String> {
        match self.number_of(name)? {
            Some(number) if number > 0.0 => Ok(number),
            Some(number) => Err(format!("its geometry's {name} is {number}, not positive")),
            None => Err(format!("its geometry has no {name}")),
        }
    }
}

impl Part {
    fn checked(&self, of: &str) -> Result<[f64; 3], String> {
        let Self { height, lower, upper } = *self;
        let all = [height, lower, upper];
        let sound = all.iter().all(|v| v.is_finite() && *v >= 0.0) && (lower > 0.0 || upper > 0.0);
        if sound { Ok(all) } else { Err(format!("a segment of {of} measures {all:?}")) }
    }
}
