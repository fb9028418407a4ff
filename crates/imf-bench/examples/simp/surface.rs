//! From densities to a surface: marching cubes over the design, what stays solid and the domain's own faces.
//!
//! Where the domain or what stays solid bounds the part, values are distances, so that bores come out round and faces flat;
//! between, density less its threshold does for one.

use std::collections::HashMap;

use glam::DVec3;
use imf_core::mesh::Mesh;
use imf_core::parts::bracket::SIZE;
use lin_alg::f32::Vec3;
use mcubes::{MarchingCubes, MeshSide};

use crate::bracket::{domain, fixed};
use crate::lattice::Lattice;

/// Cells of the surface's lattice along each axis. The part's outer faces halve a cell.
const CELLS: [usize; 3] = [28, 84, 50];
/// Millimetres over which density falls from 1 to 0, about.
const SLOPE: f64 = 4.0;
/// Values are kept this far from zero, in millimetres: no vertex meets another.
const APART: f64 = 0.03;
/// Coordinates are rounded to so many parts of a millimetre.
const PARTS: f64 = 1000.0;

/// The density of a quarter anywhere in the part: trilinear between the centres of elements.
fn density(quarter: Lattice, values: &[f64], p: DVec3) -> f64 {
    let half = DVec3::from_array(SIZE) / 2.0;
    let mirrored = DVec3::new(half.x - (p.x - half.x).abs(), half.y - (p.y - half.y).abs(), p.z);
    let sides = [0, 1, 2].map(|axis| SIZE[axis] / [2.0, 2.0, 1.0][axis] / quarter.n[axis] as f64);
    let corner = [0, 1, 2].map(|axis| {
        let most = quarter.n[axis] as f64 - 1.0;
        let at = (mirrored[axis] / sides[axis] - 0.5).clamp(0.0, most);
        let low = at.floor().min(most - 1.0);
        (low as usize, at - low)
    });
    crate::element::corners()
        .map(|place| {
            let weight: f64 =
                (0..3).map(|a| if place[a] == 0 { 1.0 - corner[a].1 } else { corner[a].1 }).product();
            weight * values[quarter.element([0, 1, 2].map(|a| corner[a].0 + place[a]))]
        })
        .sum()
}

/// The density above which as much is solid as the densities hold.
pub(crate) fn threshold(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let solid = values.iter().sum::<f64>().round() as usize;
    sorted[solid.min(sorted.len() - 1)]
}

/// The surface, its largest piece: closed, facing outwards.
pub(crate) fn surface(quarter: Lattice, values: &[f64]) -> Result<Mesh, std::io::Error> {
    let threshold = threshold(values);
    let cell = [0, 1, 2].map(|axis| SIZE[axis] / CELLS[axis] as f64);
    let place =
        |i: [f64; 3]| DVec3::new(cell[0] * (i[0] - 0.5), cell[1] * (i[1] - 0.5), cell[2] * (i[2] - 0.5));
    let n = CELLS.map(|cells| cells + 2);
    let value = |i: [usize; 3]| {
        let p = place(i.map(|i| i as f64));
        let designed = SLOPE * (threshold - density(quarter, values, p));
        let value = domain(p).max(designed.min(fixed(p)));
        if value.abs() < APART { APART.copysign(value) } else { value }
    };
    let mut field = Vec::with_capacity(n.iter().product());
    for k in 0..n[2] {
        for j in 0..n[1] {
            field.extend((0..n[0]).map(|i| value([i, j, k])));
        }
    }
    let single = field.iter().map(|&v| v as f32).collect();
    let unit = (1.0, 1.0, 1.0);
    let origin = Vec3::new_zero();
    let cubes = MarchingCubes::new((n[0], n[1], n[2]), unit, unit, origin, single, 0.0)?;
    let soup = cubes.generate(MeshSide::OutsideOnly);
    let mut mesh = Mesh::default();
    let mut known: HashMap<([usize; 3], usize), u32> = HashMap::new();
    let mut corners = Vec::with_capacity(soup.indices.len());
    for &index in &soup.indices {
        let p = soup.vertices[index].posit;
        let at = [p.x, p.y, p.z].map(f64::from);
        // On an edge of the lattice, two coordinates are whole: the edge names the vertex, whichever cell it came from.
        let axis = (0..3).max_by(|&a, &b| off(at[a]).total_cmp(&off(at[b]))).unwrap_or(0);
        let mut low = at.map(|v| v.round() as usize);
        low[axis] = at[axis].floor() as usize;
        let next = mesh.vertices.len() as u32;
        let vertex = *known.entry((low, axis)).or_insert(next);
        if vertex == next {
            let mut high = low;
            high[axis] += 1;
            let [a, b] = [low, high].map(|i| field[i[0] + n[0] * (i[1] + n[1] * i[2])]);
            let mut exact = low.map(|i| i as f64);
            exact[axis] += a / (a - b);
            mesh.vertices.push((place(exact) * PARTS).round() / PARTS);
        }
        corners.push(vertex);
    }
    mesh.triangles = corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    let mut mesh = largest_piece(&mesh);
    if mesh.signed_volume() < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Ok(mesh)
}

/// How far from a whole number.
fn off(v: f64) -> f64 {
    (v - v.round()).abs()
}

/// The piece with the most triangles: without the shells of closed cavities, which become solid.
fn largest_piece(mesh: &Mesh) -> Mesh {
    let mut label: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    loop {
        let mut changed = false;
        for triangle in &mesh.triangles {
            let least = triangle.map(|v| label[v as usize]).into_iter().fold(u32::MAX, u32::min);
            for v in triangle {
                changed |= label[*v as usize] != least;
                label[*v as usize] = least;
            }
        }
        if !changed {
            break;
        }
    }
    let mut sizes: HashMap<u32, usize> = HashMap::new();
    mesh.triangles.iter().for_each(|t| *sizes.entry(label[t[0] as usize]).or_default() += 1);
    let largest =
        sizes.into_iter().max_by_key(|&(label, size)| (size, u32::MAX - label)).map(|(label, _)| label);
    let triangles = mesh.triangles.iter().filter(|t| Some(label[t[0] as usize]) == largest).copied();
    Mesh { vertices: mesh.vertices.clone(), triangles: triangles.collect() }.welded()
}
