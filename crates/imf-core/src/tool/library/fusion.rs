//! Fusion's tool libraries: `{"data": [tool, …]}`, each tool with its type, its unit, its geometry under the short names of
//! ISO 13399, and its holder.
//!
//! ```text
//! DC  cutting diameter        LCF  length of the edges          LB    from the tip to the holder's face
//! RE  corner radius           TA   taper in degrees a side      SFDM  shaft's diameter
//! SIG point's whole angle     OAL length from end to end
//! DCX diameter of a face mill's widest inserts
//! shoulder-length, shoulder-diameter: between the edges and the shaft
//! ```
//! The cutting diameter of a tapered mill is its flank's at the height of the tip: its corner touches the flank, and a ball's is
//! larger than half of it. The shaft's own segments, where there are any, begin at the shoulder's end; `SFDM` reaches from there or from them to the
//! holder. Holders have a unit of their own; their segments stand from the face upwards. What is unexpected in one entry is an
//! error of its tool alone.

use std::borrow::Cow;
use std::io::Read as _;

use serde::Deserialize;
use serde_json::Value;

use super::{Entry, Fault, ROUNDED_DIGITS, Stack, damaged, end_mill, line, pointed, refused, top};
use crate::tool::{Segment, Tool};
use crate::unit::LengthUnit;

#[derive(Deserialize)]
struct Library {
    data: Vec<EntryText>,
}

/// Of any kind each, so that what is unexpected spoils no other entry.
#[derive(Default, Deserialize)]
#[serde(default)]
struct EntryText {
    #[serde(rename = "type")]
    kind: Value,
    unit: Value,
    description: Value,
    #[serde(rename = "product-id")]
    product: Value,
    geometry: Value,
    shaft: Value,
    holder: Value,
    #[serde(rename = "post-process")]
    post: Value,
}

#[derive(Deserialize, Default)]
struct Segments {
    #[serde(default)]
    unit: Option<String>,
    #[serde(default)]
    segments: Option<Vec<Part>>,
}

#[derive(Deserialize)]
struct Part {
    height: f64,
    #[serde(rename = "lower-diameter")]
    lower: f64,
    #[serde(rename = "upper-diameter")]
    upper: f64,
}

/// Maximum number of unpacked bytes for each byte of an archive.
const MAX_UNFOLDING: u64 = 200;

/// The tools of a `.json` or `.tools` file.
pub(super) fn entries(bytes: &[u8]) -> Result<Vec<Entry>, Fault> {
    let text = if bytes.starts_with(b"PK") {
        Cow::Owned(unpacked_json(bytes).map_err(damaged)?)
    } else {
        Cow::Borrowed(bytes)
    };
    let library: Library =
        serde_json::from_slice(text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text)).map_err(damaged)?;
    let tools = library.data.iter().filter(|text| word(&text.kind) != "holder");
    let entry = |text: &EntryText| Entry { title: text.title(), names: text.names(), tool: text.tool() };
    Ok(tools.map(entry).collect())
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

/// A text, or a number as one; nothing else.
fn word(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.to_string(),
        _ => String::new(),
    }
}

/// The unit that a text names.
fn unit(text: &str) -> Result<LengthUnit, String> {
    text.parse().map_err(|_| format!("its unit '{text}' is not known"))
}

impl EntryText {
    /// What people call it.
    fn title(&self) -> String {
        let mut names =
            [word(&self.description).trim().to_owned(), self.number(), word(&self.product)].into_iter();
        names.find(|name| !name.is_empty()).unwrap_or_default()
    }

    fn names(&self) -> Vec<String> {
        vec![word(&self.description), word(&self.product), self.number()]
    }

    /// Its number in the machine.
    fn number(&self) -> String {
        self.post.get("number").map(word).unwrap_or_default()
    }

    /// Its type, in Fusion's words.
    fn kind(&self) -> Result<String, String> {
        Some(word(&self.kind)).filter(|kind| !kind.is_empty()).ok_or_else(|| "it has no type".into())
    }

    /// The segments of the shaft or the holder, none where there is none.
    fn segments(value: &Value, of: &str) -> Result<Segments, String> {
        let segments: Option<Segments> =
            Deserialize::deserialize(value).map_err(|wrong| format!("{of} is not understood: {wrong}"))?;
        Ok(segments.unwrap_or_default())
    }

    fn tool(&self) -> Result<Tool, Fault> {
        let name = self.title();
        let (unit, stack) = self.stack().map_err(|what| refused(&name, &what))?;
        let overall_length = self.overall().map_err(|what| refused(&name, &what))?;
        let plunge_only = matches!(&*word(&self.kind), "drill" | "spot drill" | "counter sink" | "reamer");
        Ok(Tool { overall_length, plunge_only, ..stack.tool(name, unit) })
    }

    /// The unit that the entry states, and its parts in it.
    fn stack(&self) -> Result<(LengthUnit, Stack), String> {
        let kind = self.kind()?;
        let named = Some(word(&self.unit)).filter(|named| !named.is_empty()).ok_or("it has no unit")?;
        let unit_here = unit(&named)?;
        let cutter = self.cutter(&kind)?;
        let face = self.positive("LB")?;
        if let Some(whole) = self.overall()?.filter(|whole| face > whole * (1.0 + 1e-9)) {
            return Err(format!(
                "it sticks out of its holder (LB {face}) by more than its length (OAL {whole})"
            ));
        }
        let width = cutter.last().map_or(0.0, |last| last.radius(top(&cutter)));
        let shank = self.shank(top(&cutter), width, face)?;
        let Segments { unit: named, segments } = Self::segments(&self.holder, "its holder")?;
        let theirs = named.as_deref().map_or(Ok(unit_here), unit)?;
        let scale = theirs.in_mm() / unit_here.in_mm();
        let mut holder = Vec::new();
        for part in segments.iter().flatten().filter(|part| part.height != 0.0) {
            holder.push(part.checked("the holder")?.map(|length| length * scale));
        }
        let face = if holder.is_empty() { face.min(top(&shank).max(top(&cutter))) } else { face };
        Ok((unit_here, Stack { cutter, shank, face, holder }))
    }

    fn cutter(&self, kind: &str) -> Result<Vec<Segment>, String> {
        // Of the types that have them: others need not have these numbers.
        let radius = || self.positive("DC").map(|diameter| 0.5 * diameter);
        let edges = || self.positive("LCF");
        let or_0 = |name: &str| self.number_of(name).map(Option::unwrap_or_default);
        let tip = || or_0("tip-diameter").map(|tip| 0.5 * tip);
        let point = || self.positive("SIG").map(|whole| 0.5 * whole);
        let straight = |corner: f64| match (or_0("TA")?, or_0("RE")?) {
            (taper, _) if taper > 0.0 => {
                Err(format!("it has a taper (TA {taper}), which its type '{kind}' has not"))
            }
            // A ball's is half of a diameter, either of them rounded off; 0 where none is stated.
            (_, stated) if stated > 0.0 && (stated - corner).abs() > ROUNDED_DIGITS * corner => Err(format!(
                "it has a corner radius (RE {stated}) that its type '{kind}' has not, where it is {corner}"
            )),
            _ => end_mill(radius()?, corner, 0.0, edges()?),
        };
        match kind {
            "flat end mill" | "reamer" => straight(0.0),
            "face mill" => match self.number_of("DCX")? {
                Some(widest) if widest > 2.0 * radius()? * (1.0 + 1e-9) => Err(format!(
                    "a face mill whose inserts widen it (DCX {widest}) has no place among our cutters"
                )),
                _ => end_mill(radius()?, or_0("RE")?, or_0("TA")?, edges()?),
            },
            "ball end mill" => straight(radius()?),
            "bull nose end mill" => straight(self.number_of("RE")?.ok_or("its geometry has no RE")?),
            "tapered mill" => end_mill(radius()?, or_0("RE")?, or_0("TA")?, edges()?),
            "chamfer mill" => pointed(tip()?, radius()?, or_0("TA")?, edges()?),
            "drill" => pointed(0.0, radius()?, point()?, edges()?),
            "spot drill" | "counter sink" => pointed(tip()?, radius()?, point()?, edges()?),
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
        let shaft = Self::segments(&self.shaft, "its shaft")?;
        for part in shaft.segments.iter().flatten().filter(|part| part.height != 0.0) {
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

    /// From end to end; a library that states none has 0.
    fn overall(&self) -> Result<Option<f64>, String> {
        Ok(self.number_of("OAL")?.filter(|&whole| whole > 0.0))
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
