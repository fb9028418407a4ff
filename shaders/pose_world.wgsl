// Purpose: what a pose in world coordinates is to a network; shared by the kernels that answer poses. The twin in
// Rust is `imf_fields::field`.

struct Pose {
    /// Tip in the world; w is idle.
    position: vec4<f32>,
    /// Quaternion from the tool's frame into the world, x, y, z, w, of any length but 0.
    rotation: vec4<f32>,
}

const PI: f32 = 3.14159265358979;
/// Components of a direction below this are 0, as on the CPU.
const STEP: f32 = 1e-7;

/// True of finite numbers; compilers may take NaN for impossible, so bits are asked.
fn is_finite(v: vec4<f32>) -> bool {
    return all((bitcast<vec4<u32>>(v) & vec4<u32>(0x7f800000u)) != vec4<u32>(0x7f800000u));
}

/// True where every number is finite and the quaternion has a length.
fn is_pose(pose: Pose) -> bool {
    let largest = max(max(abs(pose.rotation.x), abs(pose.rotation.y)), max(abs(pose.rotation.z), abs(pose.rotation.w)));
    return is_finite(vec4<f32>(pose.position.xyz, 0.0)) && is_finite(pose.rotation) && largest > 0.0;
}

/// The bits of NaN, which WGSL refuses as a constant: `idle` is any number of the host's, so that no compiler knows them.
fn world_nan(idle: u32) -> u32 {
    return 0x7fc00000u | (idle & 0u);
}

/// The quaternion, of length 1.
fn unit_rotation(pose: Pose) -> vec4<f32> {
    let largest = max(max(abs(pose.rotation.x), abs(pose.rotation.y)), max(abs(pose.rotation.z), abs(pose.rotation.w)));
    return normalize(pose.rotation / largest);
}

/// Unit vector from tip to holder.
fn axis_of(pose: Pose) -> vec3<f32> {
    let q = unit_rotation(pose);
    let axis = vec3<f32>(
        2.0 * (q.x * q.z + q.w * q.y),
        2.0 * (q.y * q.z - q.w * q.x),
        q.w * q.w + q.z * q.z - q.x * q.x - q.y * q.y,
    );
    return normalize(select(axis, vec3<f32>(), abs(axis) < vec3<f32>(STEP)));
}

/// A pose's tip, held in a box; some point of it for an invalid pose.
fn held_tip(pose: Pose, low: vec3<f32>, high: vec3<f32>) -> vec3<f32> {
    if is_pose(pose) {
        return clamp(pose.position.xyz, low, high);
    }
    return low;
}

/// Slopes by the tip, 0 along the axes where the box holds it.
fn held_slopes(pose: Pose, low: vec3<f32>, high: vec3<f32>, slopes: vec3<f32>) -> vec3<f32> {
    return select(vec3<f32>(), slopes, held_tip(pose, low, high) == pose.position.xyz);
}

/// The longest edge.
fn longest(size: vec4<f32>) -> f32 {
    return max(size.x, max(size.y, size.z));
}

/// Angle of (x, y) in (−π, π]. WGSL's own may be off by 4096 units in the last place; this by a few. The polynomial is that
/// of Cephes' atanf, for |t| ≤ tan(π/8).
fn angle_of(y: f32, x: f32) -> f32 {
    let low = min(abs(x), abs(y));
    let high = max(abs(x), abs(y));
    if high == 0.0 {
        return 0.0;
    }
    let over = low > 0.41421356 * high;
    let t = select(low / high, (low - high) / (low + high), over);
    let z = t * t;
    let polynomial = ((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z - 3.33329491539e-1;
    var angle = polynomial * z * t + t + select(0.0, 0.25 * PI, over);
    angle = select(angle, 0.5 * PI - angle, abs(y) > abs(x));
    angle = select(angle, PI - angle, x < 0.0);
    return select(angle, -angle, y < 0.0);
}

/// True of a direction that has every θ.
fn is_vertical(axis: vec3<f32>) -> bool {
    return axis.x == 0.0 && axis.y == 0.0;
}

/// θ in [0, 2π) and φ in [0, π] of a direction; of a vertical one the middle θ, where the network is asked.
fn angles_of(axis: vec3<f32>) -> vec2<f32> {
    let angle = angle_of(axis.y, axis.x);
    let theta = select(angle, angle + 2.0 * PI, angle < 0.0);
    return vec2<f32>(select(theta, PI, is_vertical(axis)), angle_of(length(axis.xy), axis.z));
}
