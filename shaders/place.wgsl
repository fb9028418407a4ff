// Purpose: the frame of a place, of symmetry-reduced fields: mirror planes fold the position, and about
// an axis the frame turns with the point. Without symmetry it is the world's, to the bit. Shared by the kernels that answer
// poses; needs `symmetry`. The twin in Rust is `imf_fields::factored::Symmetry`.

struct Place {
    /// On the far side of every mirror: where coordinates are larger.
    position: vec3<f32>,
    /// −1 along what was mirrored, 1 elsewhere.
    signs: vec3<f32>,
    /// Cosine and sine of the angle about the axis; on it the angle is 0.
    turn: vec2<f32>,
    /// From the axis.
    distance: f32,
}

/// A vector's numbers in the order that ends with the axis, right-handed.
fn in_order(v: vec3<f32>) -> vec3<f32> {
    if symmetry.along == 0u {
        return v.yzx;
    }
    return select(v, v.zxy, symmetry.along == 1u);
}

/// And back.
fn out_of_order(v: vec3<f32>) -> vec3<f32> {
    if symmetry.along == 0u {
        return v.zxy;
    }
    return select(v, v.yzx, symmetry.along == 1u);
}

fn place_of(position: vec3<f32>) -> Place {
    let planes = vec3<f32>(symmetry.plane_x, symmetry.plane_y, symmetry.plane_z);
    let mirrored = position < planes;
    let folded = select(position, planes + (planes - position), mirrored);
    let signs = select(vec3<f32>(1.0), vec3<f32>(-1.0), mirrored);
    var place = Place(folded, signs, vec2<f32>(1.0, 0.0), 0.0);
    if symmetry.along != NO_AXIS {
        let through = vec3<f32>(symmetry.through_x, symmetry.through_y, symmetry.through_z);
        let across = in_order(folded - through).xy;
        place.distance = length(across);
        if place.distance > 0.0 {
            place.turn = across / place.distance;
        }
    }
    return place;
}

/// A direction of the world in the place's frame.
fn to_local(place: Place, direction: vec3<f32>) -> vec3<f32> {
    let d = in_order(direction * place.signs);
    let turn = place.turn;
    return vec3<f32>(turn.x * d.x + turn.y * d.y, turn.x * d.y - turn.y * d.x, d.z);
}

/// And back.
fn to_world(place: Place, local: vec3<f32>) -> vec3<f32> {
    let turn = place.turn;
    let d = vec3<f32>(turn.x * local.x - turn.y * local.y, turn.y * local.x + turn.x * local.y, local.z);
    return out_of_order(d) * place.signs;
}

/// The angle's derivative by the folded position, of fields with an axis; 0 on it.
fn angle_slopes(place: Place) -> vec3<f32> {
    let blunt = symmetry.blunt;
    let per_length = select(1.0 / place.distance, place.distance / (blunt * blunt), place.distance < blunt);
    return out_of_order(vec3<f32>(-place.turn.y, place.turn.x, 0.0)) * per_length;
}
