//! Meshes and tools that several tests use, as their files say them.

/// A triangle short of a cube of edge 100: an open mesh.
pub(crate) const OPEN_CUBE: &str = "v 0 0 0\nv 100 0 0\nv 0 100 0\nv 100 100 0\nv 0 0 100\nv 100 0 100\nv 0 100 100\n\
                                    v 100 100 100\nf 1 3 4\nf 1 4 2\nf 5 6 8\nf 5 8 7\nf 1 2 6\nf 1 6 5\nf 3 7 8\n\
                                    f 3 8 4\nf 1 5 7\nf 1 7 3\nf 2 4 8\n";
/// The last triangle.
pub(crate) const LAST_FACE: &str = "f 2 8 6\n";

/// A block between two corners; `first` vertices stand before its own in the file.
pub(crate) fn cuboid(lower: [i32; 3], upper: [i32; 3], first: usize) -> String {
    let [x0, y0, z0] = lower;
    let [x1, y1, z1] = upper;
    let mut text = String::new();
    for z in [z0, z1] {
        for [x, y] in [[x0, y0], [x1, y0], [x1, y1], [x0, y1]] {
            text += &format!("v {x} {y} {z}\n");
        }
    }
    for face in [[4, 3, 2, 1], [5, 6, 7, 8], [1, 2, 6, 5], [2, 3, 7, 6], [3, 4, 8, 7], [4, 1, 5, 8]] {
        let [a, b, c, d] = face.map(|v: usize| v + first);
        text += &format!("f {a} {b} {c} {d}\n");
    }
    text
}
