//! FreeCAD's tool bits: one tool a file, its shape by name, its measures as texts with units.
//!
//! Diameter, cutting edge and length are those of FreeCAD's own shapes: `TipAngle` and `CuttingEdgeAngle` are the whole angle
//! of the point, `TaperAngle` that of a tapered ball's cone up to `TaperDiameter`. `CuttingEdgeHeight` is the height of a chamfer's
//! cone, whose width follows from it and not from `Diameter`; of a V-bit it is that of a cylinder above the cone. The tool is as long as its `Stickout`, where there is one, else as its `Length`.

use std::collections::HashMap;

use serde::Deserialize;
use serde_json::Value;

use super::{Entry, Fault, ROUNDED_DIGITS, Stack, damaged, end_mill, line, pointed, refused, top};
use crate::tool::{Segment, Tool};
use crate::unit::LengthUnit;

#[derive(Deserialize)]
struct Bit {
    #[serde(default)]
    name: String,
    #[serde(default)]
    shape: String,
    #[serde(default, rename = "shape-type")]
    shape_type: String,
    parameter: HashMap<String, Value>,
}

/// The tool of a `.fctb` file.
pub(super) fn entry(bytes: &[u8]) -> Result<Entry, Fault> {
    let bit: Bit = serde_json::from_slice(bytes).map_err(damaged)?;
    Ok(Entry { tool: bit.tool(), title: bit.name.clone(), names: vec![bit.name] })
}

impl Bit {
    fn tool(&self) -> Result<Tool, Fault> {
        let stack = self.stack().map_err(|what| refused(&self.name, &what))?;
        let overall_length = self.optional_length("Length").ok().flatten();
        let plunge_only = matches!(&*self.kind(), "drill" | "reamer");
        Ok(Tool { overall_length, plunge_only, ..stack.tool(&self.name, LengthUnit::Mm) })
    }

    /// Lower-case name of the shape: that of its kind, or of its file.
    fn kind(&self) -> String {
        let name = if self.shape_type.is_empty() { &self.shape } else { &self.shape_type };
        let name = name.to_lowercase();
        let name = name.strip_suffix(".fcstd").unwrap_or(&name);
        // Folders, and the spellings of one shape.
        name.rsplit(['/', '\\']).next().unwrap_or(name).replace(['-', '_', ' '], "")
    }

    fn stack(&self) -> Result<Stack, String> {
        let kind = self.kind();
        let radius = || self.length("Diameter").map(|diameter| 0.5 * diameter);
        let tip = || self.optional_length("TipDiameter").map(|tip| 0.5 * tip.unwrap_or(0.0));
        let whole = self.length("Length")?;
        let edge = || self.length("CuttingEdgeHeight");
        let cutter = match kind.as_str() {
            "endmill" | "reamer" => end_mill(radius()?, 0.0, 0.0, edge()?)?,
            "ballend" => end_mill(radius()?, radius()?, 0.0, edge()?)?,
            "taperedballnose" => self.tapered_ball(radius()?, edge()?)?,
            "bullnose" | "torus" => end_mill(radius()?, self.corner(radius()?)?, 0.0, edge()?)?,
            "drill" => pointed(0.0, radius()?, 0.5 * self.angle("TipAngle")?, whole)?,
            "vbit" => {
                let half_angle = 0.5 * self.angle("CuttingEdgeAngle")?;
                let point = top(&pointed(tip()?, radius()?, half_angle, 0.0)?);
                pointed(tip()?, radius()?, half_angle, point + edge()?)?
            }
            "chamfer" => {
                let (tip, half_angle) = (tip()?, 0.5 * self.angle("CuttingEdgeAngle")?);
                let radius = tip + edge()? * half_angle.to_radians().tan();
                pointed(tip, radius, half_angle, edge()?)?
            }
            "" => return Err("the file names no shape".into()),
            other => return Err(format!("its shape '{other}' has no place among our cutters")),
        };
        let shank = self.shank(&cutter, whole)?;
        let face = self.optional_length("Stickout")?.filter(|&length| length > 0.0).unwrap_or(whole);
        let end = top(&shank).max(top(&cutter));
        Ok(Stack { cutter, shank, face: face.min(end), holder: Vec::new() })
    }

    /// A ball, the cone that touches it, as far as its diameter at the top, and a cylinder up to the edge's end.
    fn tapered_ball(&self, ball: f64, edge: f64) -> Result<Vec<Segment>, String> {
        let half_angle = 0.5 * self.angle("TaperAngle")?;
        let (sine, cosine) = half_angle.to_radians().sin_cos();
        let flank = ball * (1.0 - sine) / cosine;
        let mut profile = end_mill(flank, ball, half_angle, edge)?;
        let Some(widest) = self.optional_length("TaperDiameter")?.filter(|&widest| widest > 0.0) else {
            return Ok(profile);
        };
        let [below, above] =
            [ball, profile.last().map_or(0.0, |cone| cone.radius(edge))].map(|radius| 2.0 * radius);
        if !(below * (1.0 - ROUNDED_DIGITS)..=above * (1.0 + ROUNDED_DIGITS)).contains(&widest) {
            return Err(format!(
                "TaperDiameter is {widest} mm, and its Diameter, TaperAngle and CuttingEdgeHeight make a cone from {below} to {above:.3} mm"
            ));
        }
        let top = (0.5 * widest - flank) * cosine / sine;
        if let Some(cone) = profile.pop_if(|cone| cone.range().0 < top && top < edge) {
            profile.extend([cone.between(cone.range().0, top), line(top, edge, 0.5 * widest, 0.5 * widest)]);
        }
        Ok(profile)
    }

    fn corner(&self, radius: f64) -> Result<f64, String> {
        for name in ["CornerRadius", "TorusRadius"] {
            if let Some(corner) = self.optional_length(name)? {
                return Ok(corner);
            }
        }
        let flat = self.optional_length("FlatRadius")?.ok_or("CornerRadius is missing")?;
        if flat > radius * (1.0 + ROUNDED_DIGITS) {
            return Err(format!("FlatRadius {flat} mm is larger than the cutter's radius {radius} mm"));
        }
        Ok((radius - flat).max(0.0))
    }

    fn shank(&self, cutter: &[Segment], whole: f64) -> Result<Vec<Segment>, String> {
        let from = top(cutter);
        if whole <= from {
            return Ok(Vec::new());
        }
        let radius = 0.5 * self.length("ShankDiameter")?;
        Ok(vec![line(from, whole, radius, radius)])
    }

    /// A length in mm that must be there and positive.
    fn length(&self, name: &str) -> Result<f64, String> {
        let found = self.optional_length(name)?.ok_or_else(|| format!("{name} is missing"))?;
        if found > 0.0 { Ok(found) } else { Err(format!("{name} is {found} mm, not positive")) }
    }

    /// A length in mm, not negative.
    fn optional_length(&self, name: &str) -> Result<Option<f64>, String> {
        let Some(value) = self.parameter.get(name) else { return Ok(None) };
        let (number, unit) = measure(value).ok_or_else(|| format!("{name} is {value}, no length"))?;
        let factor = match unit.as_str() {
            // FreeCAD's own unit.
            "" | "mm" => 1.0,
            "um" | "µm" | "μm" => 1e-3,
            "thou" | "mil" => 0.0254,
            "in" | "inch" | "\"" => LengthUnit::Inch.in_mm(),
            "ft" | "'" => 12.0 * LengthUnit::Inch.in_mm(),
            "cm" => LengthUnit::Cm.in_mm(),
            "m" => LengthUnit::M.in_mm(),
            _ => return Err(format!("{name} is {value}: '{unit}' is not a unit of length that is known")),
        };
        let length = number * factor;
        if length >= 0.0 { Ok(Some(length)) } else { Err(format!("{name} is {value}, which is negative")) }
    }

    /// A whole angle in degrees.
    fn angle(&self, name: &str) -> Result<f64, String> {
        let value = self.parameter.get(name).ok_or_else(|| format!("{name} is missing"))?;
        let (number, unit) = measure(value).ok_or_else(|| format!("{name} is {value}, no angle"))?;
        match unit.as_str() {
            "" | "°" | "deg" => Ok(number),
            "rad" => Ok(number.to_degrees()),
            _ => Err(format!("{name} is {value}: '{unit}' is not a unit of angle that is known")),
        }
    }
}

/// Number and unit of a value such as 6, "6.0000 mm", "6,00 mm" or "60.0000 °".
fn measure(value: &Value) -> Option<(f64, String)> {
    let (number, unit) = match value {
        Value::Number(number) => (number.as_f64()?, ""),
        Value::String(text) => {
            let text = text.trim();
            let end = text
                .find(|c: char| !matches!(c, '0'..='9' | '+' | '-' | '.' | ',' | 'e' | 'E'))
                .unwrap_or(text.len());
            (text[..end].replace(',', ".").parse().ok()?, text[end..].trim())
        }
        _ => return None,
    };
    number.is_finite().then(|| (number, unit.to_lowercase()))
}
