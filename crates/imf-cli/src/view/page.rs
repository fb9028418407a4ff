//! The page in 3D: one HTML file that needs no network.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use glam::DVec3;
use imf_core::atomic_file::write_atomically;
use serde_json::{Value, json};

use super::{Colours, Layer, NONE, Table, View, ramp};

const PAGE: &str = include_str!("../../viewer/page.html");
const STYLE: &str = include_str!("../../viewer/viewer.css");
const VIEWER: &str = include_str!("../../viewer/viewer.js");
const THREE: &str = include_str!("../../viewer/three.min.js");
/// Colours of a scale's ramp.
const STEPS: usize = 64;

impl View<'_> {
    /// Writes the page, whole or not at all.
    pub(crate) fn write_page(&self, path: &Path) -> Result<()> {
        let tables: String = self.tables.iter().map(Table::html).collect();
        let tables = format!("{tables}<h2>Summary</h2>\n<pre>{}</pre>", escaped(&self.summary));
        // An end tag in a string would end the script.
        let data = self.data().to_string().replace("</", "<\\/");
        let parts = [
            ("title", escaped(&self.title)),
            ("style", STYLE.to_owned()),
            ("tables", tables),
            ("data", data),
            ("three", THREE.to_owned()),
            ("viewer", VIEWER.to_owned()),
        ];
        // One pass over the template: what is put in may hold braces.
        let mut page =
            String::with_capacity(parts.iter().map(|(_, text)| text.len()).sum::<usize>() + PAGE.len());
        let mut pieces = PAGE.split("{{");
        page.push_str(pieces.next().unwrap_or_default());
        for piece in pieces {
            let (name, rest) = piece.split_once("}}").unwrap_or((piece, ""));
            page.push_str(parts.iter().find(|(own, _)| *own == name).map_or("", |(_, text)| text));
            page.push_str(rest);
        }
        Ok(write_atomically(path, |out| std::io::Write::write_all(out, page.as_bytes()))?)
    }

    fn data(&self) -> Value {
        let (low, high) = self.focus.or_else(|| self.mesh.bounds()).unwrap_or_default();
        let middle = 0.5 * (low + high);
        let relative = |points: &mut dyn Iterator<Item = DVec3>| {
            floats(points.flat_map(|at| (at - middle).as_vec3().to_array()))
        };
        let corners = (0..self.mesh.triangles.len()).flat_map(|triangle| self.mesh.corners(triangle));
        json!({
            "unit": self.unit.to_string(),
            "middle": middle.to_array(),
            "radius": (0.5 * (high - low).length()).max(f64::MIN_POSITIVE),
            "positions": relative(&mut { corners }),
            "layers": self.layers.iter().map(Layer::data).collect::<Vec<_>>(),
            "arrows": self.directions.iter().map(|d| json!({ "direction": d.to_array() })).collect::<Vec<_>>(),
            "place_name": self.place_name,
            "places": self.places.iter().map(|place| json!({
                "at": (place.at - middle).to_array(), "normal": place.normal.to_array(),
            })).collect::<Vec<_>>(),
            "paths": self.paths.iter().map(|path| json!({
                "name": path.name, "colour": path.colour, "points": relative(&mut path.pieces.iter().flatten().copied()),
            })).collect::<Vec<_>>(),
        })
    }
}

impl Layer {
    fn data(&self) -> Value {
        let mut data =
            json!({ "name": self.name, "title": self.title, "values": floats(self.values.iter().copied()) });
        let [low, high] = self.range();
        let more = match &self.colours {
            Colours::Classes(classes) => {
                let classes = classes.iter().map(|(name, colour)| json!({ "name": name, "colour": colour }));
                json!({ "classes": classes.collect::<Vec<_>>() })
            }
            Colours::Bodies(bodies) => {
                let classes =
                    bodies.iter().map(|(name, colour, _)| json!({ "name": name, "colour": colour }));
                let hidden = (0..bodies.len()).filter(|&body| bodies[body].2).collect::<Vec<_>>();
                json!({ "classes": classes.collect::<Vec<_>>(), "bodies": true, "hidden": hidden })
            }
            Colours::Scale { label, none } => {
                let ramp: Vec<_> = (0..STEPS).map(|step| ramp(step as f64 / (STEPS - 1) as f64)).collect();
                json!({ "label": label, "low": low, "high": high, "ramp": ramp, "none": { "name": none, "colour": NONE } })
            }
        };
        if let (Value::Object(data), Value::Object(more)) = (&mut data, more) {
            data.extend(more);
        }
        data
    }
}

impl Table {
    fn html(&self) -> String {
        let class = |number: bool| if number { " class=\"number\"" } else { "" };
        let mut html = format!("<h2>{}</h2>\n<table>\n<tr>", escaped(&self.title));
        for (name, number) in &self.columns {
            let _ = write!(html, "<th{}>{}</th>", class(*number), escaped(name));
        }
        html.push_str("</tr>\n");
        for row in &self.rows {
            debug_assert_eq!(row.cells.len(), self.columns.len(), "{}", self.title);
            let place = row.place.map_or_else(String::new, |place| format!(" data-place=\"{place}\""));
            let _ = write!(html, "<tr{place}>");
            for (cell, (_, number)) in row.cells.iter().zip(&self.columns) {
                let _ = write!(html, "<td{}>{}</td>", class(*number), escaped(cell));
            }
            html.push_str("</tr>\n");
        }
        html.push_str("</table>\n");
        html
    }
}

/// Values as base64 of their bytes, little-endian.
fn floats(values: impl Iterator<Item = f32>) -> String {
    BASE64.encode(values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>())
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use imf_core::mesh::Mesh;
    use imf_core::unit::LengthUnit;

    use super::super::{Place, TableRow};
    use super::*;

    #[test]
    fn what_a_user_named_neither_ends_a_script_nor_becomes_markup() {
        let mesh = Mesh { vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2]] };
        let name = "</script><b>{{data}}";
        let view = View {
            title: name.into(),
            unit: LengthUnit::Mm,
            mesh: &mesh,
            focus: None,
            layers: vec![Layer {
                name: "tool",
                title: "by tool",
                colours: Colours::Classes(vec![(name.into(), [1, 2, 3])]),
                values: vec![0.0],
            }],
            directions: vec![DVec3::Z],
            place_name: "not reached",
            places: vec![Place { at: DVec3::ZERO, normal: DVec3::Z }],
            paths: vec![],
            summary: name.into(),
            tables: vec![Table {
                title: name.into(),
                columns: vec![("why", false)],
                rows: vec![TableRow { place: Some(0), cells: vec![name.into()] }],
            }],
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.html");
        view.write_page(&path).unwrap();
        let page = std::fs::read_to_string(&path).unwrap();
        let count = |text: &str| page.matches(text).count();
        // Three scripts, and no more; the library's own text has none.
        assert_eq!((count("</script>"), count("<b>{{")), (3, 1));
        assert_eq!(count("&lt;/script&gt;&lt;b&gt;{{data}}"), 5);
        let data = page.split("id=\"data\">").nth(1).unwrap().split("</script>").next().unwrap();
        let data: Value = serde_json::from_str(data).unwrap();
        assert_eq!(data["layers"][0]["classes"][0]["name"], name);
        assert_eq!(BASE64.decode(data["positions"].as_str().unwrap()).unwrap().len(), 36);
        // The file is named once.
        let error = view.write_page(folder.path()).unwrap_err().to_string();
        assert!(error.starts_with("cannot write "), "{error}");
        // Nothing is fetched.
        assert!(!page.contains("src=") || !page.contains("<script src"));
    }
}
