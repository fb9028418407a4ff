//! A surface from six sides, shaded, as a PNG file: the same colours as on the page, for use without a browser.

use std::path::Path;

use anyhow::Result;
use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};
use imf_core::mesh::Mesh;

use super::{Colours, Layer, View};
use crate::picture::{Swatches, ViewRow, ViewSheet};

/// Longest side of a view in pixels.
const SIDE: f64 = 300.0;
/// Samples along a pixel's side.
const FINE: usize = 2;
const BACKGROUND: [f64; 3] = [255.0; 3];
/// Cosine between the normals of neighbours beyond which a line is drawn between them.
const CREASE: f64 = 0.8;

/// Where the viewer stands: name, towards the viewer, to the right.
const SIDES: [(&str, DVec3, DVec3); 6] = [
    ("from −y", DVec3::NEG_Y, DVec3::X),
    ("from +x", DVec3::X, DVec3::Y),
    ("from +z", DVec3::Z, DVec3::X),
    ("from +y", DVec3::Y, DVec3::NEG_X),
    ("from −x", DVec3::NEG_X, DVec3::NEG_Y),
    ("from −z", DVec3::NEG_Z, DVec3::X),
];

impl View<'_> {
    /// Draws every layer of classes from six sides; the legend says each class's share of the surface, as no side may show it.
    pub(crate) fn draw_sides(&self, path: &Path) -> Result<()> {
        let layers = self.layers.iter().filter_map(|layer| match &layer.colours {
            Colours::Classes(classes) => Some((layer, classes)),
            Colours::Bodies(_) | Colours::Scale { .. } => None,
        });
        let areas: Vec<f64> =
            (0..self.mesh.triangles.len()).map(|triangle| area(self.mesh, triangle)).collect();
        let whole: f64 = areas.iter().sum();
        let rows = layers.flat_map(|(layer, classes)| {
            let share = |class: usize| {
                let own = layer.values.iter().zip(&areas).filter(|(value, _)| **value == class as f32);
                100.0 * own.map(|(_, area)| area).sum::<f64>() / whole
            };
            let used =
                classes.iter().enumerate().filter(|(class, _)| layer.values.contains(&(*class as f32)));
            let named = |(class, (name, colour)): (usize, &(String, [u8; 3]))| {
                (Rgb(*colour), format!("{name}, {:.1} %", share(class)))
            };
            let swatches: Swatches = used.map(named).collect();
            let views = SIDES
                .map(|(name, towards, right)| (name.to_owned(), drawn(self.mesh, layer, towards, right)));
            let [upper, lower]: [Vec<_>; 2] = [views[..3].to_vec(), views[3..].to_vec()];
            [
                ViewRow { title: layer.title.to_owned(), views: upper, swatches: Vec::new() },
                ViewRow { title: String::new(), views: lower, swatches },
            ]
        });
        ViewSheet { title: self.title.clone(), rows: rows.collect() }.save(path)
    }
}

fn area(mesh: &Mesh, triangle: usize) -> f64 {
    let [a, b, c] = mesh.corners(triangle);
    0.5 * (b - a).cross(c - a).length()
}

/// The visible point of a triangle at a pixel.
#[derive(Clone, Copy)]
struct Fragment {
    depth: f64,
    triangle: usize,
}

/// The surface without perspective; sides of the same mesh have one scale.
fn drawn(mesh: &Mesh, layer: &Layer, towards: DVec3, right: DVec3) -> RgbImage {
    let up = towards.cross(right);
    let (low, high) = mesh.bounds().unwrap_or_default();
    let scale = FINE as f64 * SIDE / (high - low).max_element().max(f64::MIN_POSITIVE);
    let corners = [low, high].map(|at| DVec2::new(at.dot(right), at.dot(up)));
    let (left, bottom) =
        (corners[0].min(corners[1]), corners[0].max(corners[1]) - corners[0].min(corners[1]));
    let size = (bottom * scale).ceil().max(DVec2::ONE);
    let [width, height] = size.to_array().map(|side| (side as usize).next_multiple_of(FINE));
    let mut seen: Vec<Option<Fragment>> = vec![None; width * height];
    let mut normals = vec![DVec3::ZERO; mesh.triangles.len()];
    for (triangle, normal) in normals.iter_mut().enumerate() {
        let corners = mesh.corners(triangle);
        *normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        // Rows count downwards.
        let [a, b, c] = corners.map(|at| {
            let flat = (DVec2::new(at.dot(right), at.dot(up)) - left) * scale;
            DVec3::new(flat.x, height as f64 - flat.y, at.dot(towards))
        });
        let area = (b - a).truncate().perp_dot((c - a).truncate());
        if area == 0.0 {
            continue;
        }
        let (least, most) = (a.min(b).min(c), a.max(b).max(c));
        let cells = |low: f64, high: f64, count: usize| {
            (low - 0.5).ceil().max(0.0) as usize
                ..((high - 0.5).floor() + 1.0).clamp(0.0, count as f64) as usize
        };
        for row in cells(least.y, most.y, height) {
            for column in cells(least.x, most.x, width) {
                let at = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                let weight =
                    |p: DVec3, q: DVec3| (q.truncate() - p.truncate()).perp_dot(at - p.truncate()) / area;
                let [to_a, to_b, to_c] = [weight(b, c), weight(c, a), weight(a, b)];
                if to_a < 0.0 || to_b < 0.0 || to_c < 0.0 {
                    continue;
                }
                let depth = to_a * a.z + to_b * b.z + to_c * c.z;
                let place = &mut seen[row * width + column];
                if place.is_none_or(|before| depth > before.depth) {
                    *place = Some(Fragment { depth, triangle });
                }
            }
        }
    }
    shaded(&seen, width, &normals, layer, (towards, right, up), 0.02 * (high - low).length())
}

/// Light from above the viewer's shoulder, lines at edges and where one thing stands before another.
fn shaded(
    seen: &[Option<Fragment>],
    width: usize,
    normals: &[DVec3],
    layer: &Layer,
    (towards, right, up): (DVec3, DVec3, DVec3),
    step: f64,
) -> RgbImage {
    let light = (towards + 0.35 * up - 0.25 * right).normalize();
    let range = layer.range();
    let height = seen.len() / width;
    let colour = |index: usize| -> [f64; 3] {
        let Some(here) = seen[index] else { return BACKGROUND };
        let normal = normals[here.triangle];
        // A face that is turned away is the inside of an open mesh.
        let normal = if normal.dot(towards) < 0.0 { -normal } else { normal };
        let mut bright = 0.45 + 0.55 * normal.dot(light).max(0.0);
        let (row, column) = (index / width, index % width);
        let beside = [(row > 0).then(|| index - width), (column > 0).then(|| index - 1)];
        let is_line = beside.into_iter().flatten().any(|other| match seen[other] {
            None => true,
            Some(other) => {
                let bend = normals[other.triangle].dot(normals[here.triangle]);
                bend.abs() < CREASE || (other.depth - here.depth).abs() > step
            }
        });
        if is_line {
            bright *= 0.45;
        }
        layer.colour(layer.values[here.triangle], range).map(|part| f64::from(part) * bright)
    };
    let colours: Vec<[f64; 3]> = (0..seen.len()).map(colour).collect();
    RgbImage::from_fn((width / FINE) as u32, (height / FINE) as u32, |x, y| {
        let parts = (0..FINE * FINE).map(|part| {
            let (row, column) = (y as usize * FINE + part / FINE, x as usize * FINE + part % FINE);
            colours[row * width + column]
        });
        let sum = parts.fold([0.0; 3], |sum, part| [0, 1, 2].map(|channel| sum[channel] + part[channel]));
        Rgb(sum.map(|channel| (channel / (FINE * FINE) as f64).round() as u8))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wedge whose floor is 0, whose back wall (x = 0) is 1 and whose slope is 2; its two sides are 3.
    fn wedge() -> (Mesh, Layer) {
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        let vertices = vec![
            at(0.0, 0.0, 0.0),
            at(4.0, 0.0, 0.0),
            at(0.0, 0.0, 2.0),
            at(0.0, 3.0, 0.0),
            at(4.0, 3.0, 0.0),
            at(0.0, 3.0, 2.0),
        ];
        let triangles =
            vec![[0, 3, 4], [0, 4, 1], [0, 2, 5], [0, 5, 3], [1, 4, 5], [1, 5, 2], [0, 1, 2], [3, 5, 4]];
        let classes = [[200, 0, 0], [0, 200, 0], [0, 0, 200], [200, 200, 0]];
        let colours = Colours::Classes(classes.iter().map(|&c| (String::new(), c)).collect());
        let values = vec![0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0];
        (Mesh { vertices, triangles }, Layer { name: "face", title: "", colours, values })
    }

    #[test]
    fn each_side_shows_the_face_that_is_turned_to_it_at_its_place() {
        let (mesh, layer) = wedge();
        let looks = |name: &str| {
            let &(_, towards, right) = SIDES.iter().find(|(own, ..)| *own == name).unwrap();
            drawn(&mesh, &layer, towards, right)
        };
        // The strongest channels of the middle of a picture.
        let middle = |image: &RgbImage| {
            let Rgb(found) = *image.get_pixel(image.width() / 2, image.height() / 2);
            found.map(|channel| channel > 60)
        };
        assert_eq!(middle(&looks("from −x")), [false, true, false]);
        assert_eq!(middle(&looks("from +x")), [false, false, true]);
        assert_eq!(middle(&looks("from +z")), [false, false, true]);
        assert_eq!(middle(&looks("from −z")), [true, false, false]);
        // The side is a triangle: below its slope yellow, above it nothing. From −y the slope falls to the right.
        let side = looks("from −y");
        assert_eq!((side.width(), side.height()), (300, 150));
        assert!(side.get_pixel(40, 130)[0] > 60 && side.get_pixel(40, 130)[2] < 60);
        assert_eq!(side.get_pixel(270, 20), &Rgb([255; 3]));
        let side = looks("from +y");
        assert_eq!(side.get_pixel(30, 20), &Rgb([255; 3]));
        assert!(side.get_pixel(260, 130)[0] > 60);
    }
}
