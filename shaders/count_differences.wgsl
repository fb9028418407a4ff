// Purpose: by how much the overlap of tool and obstacle changes when the tool is stepped by a voxel, at every voxel of
// every job's box: bits of the obstacle at the offsets that a step covers, less those at the offsets it uncovers.
//
// One invocation computes COUNT_PLACES voxels of a line along z, all voxels of a workgroup lie in one plane x. Counts
// are bit-sliced: a digit holds one binary digit of all these voxels' counts, and a full adder takes two loads at
// once. An uncovered bit b is added as 1 − b, so that one sum serves both, and their number is taken off at the end.
//   jobs         [jobs]
//   bits         the obstacle, one bit a voxel: voxel (x, y, z) is bit lead + x·plane_bits + y·line_bits + z
//   starts       [planes + 1] for each list, where the ends of each plane begin in `ends`
//   ends         distances in bits from a voxel to its ends; they wrap
//   differences  [nx][ny][nz] for each job, in two's complement

@group(0) @binding(0) var<uniform> counting: Counting;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> bits: array<u32>;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> ends: array<u32>;
@group(0) @binding(5) var<storage, read_write> differences: array<u32>;

alias Places = vec4<u32>;
alias Digits = array<Places, COUNT_DIGITS>;

struct Sum {
    ones: Places,
    twos: Places,
}

fn full(a: Places, b: Places, c: Places) -> Sum {
    let either = a ^ b;
    return Sum(either ^ c, (a & b) | (c & either));
}

/// The obstacle's bits from `bit` on, each flipped where `flip` is all ones.
fn load(bit: u32, flip: u32) -> Places {
    let word = bit >> 5u;
    let shift = bit & 31u;
    let low = Places(bits[word], bits[word + 1u], bits[word + 2u], bits[word + 3u]);
    let high = Places(low.yzw, bits[word + 4u]);
    // In two steps: a shift by 32 is not defined.
    return ((low >> Places(shift)) | ((high << Places(31u - shift)) << Places(1u))) ^ Places(flip);
}

/// Adds `carry` to a digit; returns what goes to the next.
fn half(digits: ptr<function, Digits>, digit: u32, carry: Places) -> Places {
    let before = (*digits)[digit];
    (*digits)[digit] = before ^ carry;
    return before & carry;
}

/// Adds eight ends to digits 0 to 2; the carry has weight 8.
fn eight(digits: ptr<function, Digits>, base: u32, at: u32, flip: u32) -> Places {
    let a = full((*digits)[0], load(base + ends[at], flip), load(base + ends[at + 1u], flip));
    let b = full(a.ones, load(base + ends[at + 2u], flip), load(base + ends[at + 3u], flip));
    let c = full((*digits)[1], a.twos, b.twos);
    let d = full(b.ones, load(base + ends[at + 4u], flip), load(base + ends[at + 5u], flip));
    let e = full(d.ones, load(base + ends[at + 6u], flip), load(base + ends[at + 7u], flip));
    let f = full(c.ones, d.twos, e.twos);
    let g = full((*digits)[2], c.twos, f.twos);
    (*digits)[0] = e.ones;
    (*digits)[1] = f.ones;
    (*digits)[2] = g.ones;
    return g.twos;
}

/// Adds a carry of weight 32. Written out, so that digits stay in registers with any compiler.
fn carry_32(digits: ptr<function, Digits>, carry: Places) {
    var c = half(digits, 5u, carry);
    c = half(digits, 6u, c);
    c = half(digits, 7u, c);
    c = half(digits, 8u, c);
    c = half(digits, 9u, c);
    c = half(digits, 10u, c);
    c = half(digits, 11u, c);
    c = half(digits, 12u, c);
    c = half(digits, 13u, c);
    c = half(digits, 14u, c);
    c = half(digits, 15u, c);
    c = half(digits, 16u, c);
    _ = half(digits, 17u, c);
}

/// Adds a carry of weight 8.
fn carry_8(digits: ptr<function, Digits>, carry: Places) {
    carry_32(digits, half(digits, 4u, half(digits, 3u, carry)));
}

/// Adds the ends `first..last` seen from bit `base`.
fn add(digits: ptr<function, Digits>, base: u32, first: u32, last: u32, flip: u32) {
    var at = first;
    for (; at + 32u <= last; at += 32u) {
        let a = eight(digits, base, at, flip);
        let b = eight(digits, base, at + 8u, flip);
        let c = full((*digits)[3], a, b);
        let d = eight(digits, base, at + 16u, flip);
        let e = eight(digits, base, at + 24u, flip);
        let f = full(c.ones, d, e);
        let g = full((*digits)[4], c.twos, f.twos);
        (*digits)[3] = f.ones;
        (*digits)[4] = g.ones;
        carry_32(digits, g.twos);
    }
    for (; at + 8u <= last; at += 8u) {
        carry_8(digits, eight(digits, base, at, flip));
    }
    for (; at < last; at += 1u) {
        let one = half(digits, 0u, load(base + ends[at], flip));
        carry_8(digits, half(digits, 2u, half(digits, 1u, one)));
    }
}

/// A digit's part of the counts at one place of each word.
fn part(digits: ptr<function, Digits>, digit: u32, place: u32) -> vec4<u32> {
    return (((*digits)[digit] >> vec4(place)) & vec4(1u)) << vec4(digit);
}

/// The ends of the planes that lie within the obstacle when the tool's tip is in plane x.
fn within(x: i32, first: i32, planes: u32, table: u32) -> vec2<u32> {
    let most = i32(planes);
    let low = clamp(-x - first, 0, most);
    let high = clamp(i32(counting.planes) - x - first, low, most);
    return vec2(starts[table + u32(low)], starts[table + u32(high)]);
}

/// The differences of one tile of a line.
fn tile(job: Job, plane: u32, line: u32, first: u32) {
    let x = job.lower_x + i32(plane);
    let y = job.lower_y + i32(line);
    let z = job.lower_z + i32(first);
    // Wraps where the tip is outside the obstacle's bits; with an end added it is inside.
    let base = counting.lead_bits + u32(x) * counting.plane_bits + u32(y) * counting.line_bits + u32(z);
    let covered = within(x, job.covered_first, job.covered_planes, job.covered_starts);
    let uncovered = within(x, job.uncovered_first, job.uncovered_planes, job.uncovered_starts);
    var digits = Digits();
    add(&digits, base, covered.x, covered.y, 0u);
    add(&digits, base, uncovered.x, uncovered.y, 0xFFFFFFFFu);
    let flipped = vec4(uncovered.y - uncovered.x);
    let target_line = job.differences + (plane * job.ny + line) * job.nz;
    for (var place = 0u; place < 32u; place += 1u) {
        let low = part(&digits, 0u, place) | part(&digits, 1u, place) | part(&digits, 2u, place)
            | part(&digits, 3u, place) | part(&digits, 4u, place) | part(&digits, 5u, place);
        let middle = part(&digits, 6u, place) | part(&digits, 7u, place) | part(&digits, 8u, place)
            | part(&digits, 9u, place) | part(&digits, 10u, place) | part(&digits, 11u, place);
        let high = part(&digits, 12u, place) | part(&digits, 13u, place) | part(&digits, 14u, place)
            | part(&digits, 15u, place) | part(&digits, 16u, place) | part(&digits, 17u, place);
        let number = (low | middle | high) - flipped;
        let at = first + place;
        if at < job.nz {
            differences[target_line + at] = number.x;
        }
        if at + 32u < job.nz {
            differences[target_line + at + 32u] = number.y;
        }
        if at + 64u < job.nz {
            differences[target_line + at + 64u] = number.z;
        }
        if at + 96u < job.nz {
            differences[target_line + at + 96u] = number.w;
        }
    }
}

@compute @workgroup_size(LINEAR_GROUP)
fn main(
    @builtin(workgroup_id) id: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(num_workgroups) groups: vec3<u32>
) {
    for (var group = id.x; group < counting.jobs * counting.groups; group += groups.x) {
        let job = jobs[group / counting.groups];
        let tiles = (job.nz + COUNT_PLACES - 1u) / COUNT_PLACES;
        // At least one, so that an empty job divides by something.
        let chunks = max(1u, (job.ny * tiles + LINEAR_GROUP - 1u) / LINEAR_GROUP);
        let place = group % counting.groups;
        let plane = place / chunks;
        let item = (place % chunks) * LINEAR_GROUP + local;
        if plane < job.nx && item < job.ny * tiles {
            tile(job, plane, item / tiles, (item % tiles) * COUNT_PLACES);
        }
    }
}
