//! Solid angles of triangles, of which winding numbers are made.

use glam::DVec3;

/// Sine and cosine, up to a common positive factor, of half the solid angle of a triangle seen from the origin
/// (van Oosterom and Strackee 1983).
pub(crate) fn half_angle([a, b, c]: [DVec3; 3]) -> (f64, f64) {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let sine = a.dot(b.cross(c));
    let cosine = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    (sine, cosine)
}

/// Generalised winding number of triangles around a point, by summing every one's solid angle: the definition.
pub(crate) fn winding_number(triangles: impl Iterator<Item = [DVec3; 3]>, point: DVec3) -> f64 {
    let angles = triangles.map(|corners| {
        let (sine, cosine) = half_angle(corners.map(|corner| corner - point));
        2.0 * sine.atan2(cosine)
    });
    angles.sum::<f64>() / (4.0 * std::f64::consts::PI)
}
