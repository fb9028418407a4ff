//! What can be said about the shaders without an adapter: they are valid, their uniform blocks are Rust's, their
//! bindings are as they should be, and naga writes each of them for Metal, Direct3D and Vulkan.

use std::mem::offset_of;

use imf_gpu::shader::{
    FRAGMENTS_MEMORY, Factors, Fragment, LINEAR_GROUP, MatrixKernel, REGISTER_GROUP, SOAP_GROUP, Shader,
    TILED_GROUP,
};
use imf_gpu::uniforms::{
    Batch, Between, Counting, Descent, Harmonics, Job, Lattice, Layer, MatrixPlace, Panel, PlaceFrame,
    Placement, Product, Side, Span, Step, Sweep, Symmetry, Thresholds, Turns, World,
};
use naga::valid::{Capabilities, ModuleInfo, ShaderStages, SubgroupOperationSet, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess, TypeInner};

/// What a shader is made for.
#[derive(Clone, Copy, Debug)]
struct Made {
    shader: Shader,
    matrix: MatrixKernel,
    factors: Factors,
}

impl Made {
    /// What its factors need beyond WebGPU's core features.
    fn capabilities(self) -> Capabilities {
        match self.factors {
            Factors::Single => Capabilities::empty(),
            Factors::Half => Capabilities::SHADER_FLOAT16 | Capabilities::SHADER_FLOAT16_IN_FLOAT32,
            Factors::Fragments(_) => {
                Capabilities::SHADER_FLOAT16 | Capabilities::COOPERATIVE_MATRIX | Capabilities::SUBGROUP
            }
        }
    }
}

/// Every shader with every matrix kernel and its factors.
fn made() -> impl Iterator<Item = Made> {
    let units = Fragment::ALL.map(|fragment| (MatrixKernel::Tiled, Factors::Fragments(fragment)));
    let plain = [Factors::Single, Factors::Half];
    let ways = MatrixKernel::ALL.into_iter().flat_map(move |matrix| plain.map(|factors| (matrix, factors)));
    ways.chain(units).flat_map(|(matrix, factors)| {
        let shaders = Shader::ALL.into_iter();
        let shaders = shaders.filter(move |shader| factors == Factors::Single || shader.is_product());
        shaders.map(move |shader| Made { shader, matrix, factors })
    })
}

/// All of them, parsed, and validated against what they need and no more.
fn modules() -> impl Iterator<Item = (String, Made, Module, ModuleInfo)> {
    made().map(|made| {
        let name = format!("{:?} ({}, {})", made.shader, made.matrix.name(), made.factors.name());
        let source = made.shader.source(made.matrix, made.factors);
        let module = naga::front::wgsl::parse_str(&source)
            .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(&source)));
        let info = Validator::new(ValidationFlags::all(), made.capabilities())
            .subgroup_stages(ShaderStages::COMPUTE)
            .subgroup_operations(SubgroupOperationSet::all())
            .validate(&module)
            .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(&source)));
        (name, made, module, info)
    })
}

#[test]
fn every_shader_is_valid_and_has_one_entry_point() {
    for (name, made, module, _) in modules() {
        assert_eq!(module.entry_points.len(), 1, "{name}");
        let entry = &module.entry_points[0];
        assert_eq!(entry.name, "main", "{name}");
        let expected = match (made.shader.is_product(), made.factors, made.matrix) {
            (false, ..) if made.shader == Shader::SoapPanel => [SOAP_GROUP, 1, 1],
            (false, ..) => [LINEAR_GROUP, 1, 1],
            (true, Factors::Fragments(_), _) => [TILED_GROUP * TILED_GROUP, 1, 1],
            (true, _, MatrixKernel::Register) => [REGISTER_GROUP, REGISTER_GROUP, 1],
            (true, _, MatrixKernel::Tiled) => [TILED_GROUP, TILED_GROUP, 1],
        };
        assert_eq!(entry.workgroup_size, expected, "{name}");
    }
}

/// `u` uniform, `r` storage that is read, `w` storage that is written, in the order of the bindings.
fn expected_bindings(shader: Shader) -> &'static str {
    match shader {
        Shader::Inputs => "uurw",
        Shader::Poses => "uuurrw",
        Shader::HiddenTrain => "uurrww",
        Shader::HiddenEvaluate | Shader::Linear | Shader::Backward => "uurrw",
        Shader::Loss | Shader::LossLinear => "uuurrww",
        Shader::LossSum | Shader::Reduce => "uurw",
        Shader::WeightGradient => "uurrw",
        Shader::BiasGradient => "uurw",
        Shader::Adam => "uurwww",
        Shader::SoapGather | Shader::SoapScatter => "urrw",
        Shader::SoapProduct => "urrw",
        Shader::SoapMoments => "uurwww",
        Shader::SoapMeans => "rrrww",
        Shader::SoapOrder => "rrrwww",
        Shader::SoapPanel => "urww",
        Shader::SoapReflect => "urrw",
        Shader::SoapFollow => "urrrrw",
        Shader::MatricesUpdate => "uurrw",
        Shader::Outputs => "uuurw",
        Shader::Minimum => "urww",
        Shader::RowMinimum => "uuurww",
        Shader::RowSections => "uuurw",
        Shader::LocalFrames => "uurw",
        Shader::PoseInputs => "uuurw",
        Shader::PosePoints => "uuuurw",
        Shader::PoseValues => "uuurrww",
        Shader::PoseGradient => "uuuurrrrrw",
        Shader::HarmonicValues | Shader::RotationValues => "uuuuurrrw",
        Shader::HarmonicSlopes | Shader::RotationSlopes => "uuuuurrrwww",
        Shader::VoxelCoefficients => "uuuurrw",
        Shader::PoseDescent => "uuuuurrrrw",
        Shader::VoxelDescent => "uuuurrrrw",
        Shader::PoseDecisions => "uuurrw",
        Shader::CountDifferences => "urrrrw",
        Shader::CountTotals => "urw",
        Shader::CountSections => "urrw",
        Shader::CountLeast => "urrrww",
        Shader::MultiplyAdds => "uw",
    }
}

#[test]
fn bindings_and_their_access_are_as_the_engine_binds_them() {
    for (name, Made { shader, .. }, module, _) in modules() {
        let mut found: Vec<(u32, char)> = module
            .global_variables
            .iter()
            .filter_map(|(_, variable)| {
                let binding = variable.binding?;
                assert_eq!(binding.group, 0, "{name}");
                let kind = match variable.space {
                    AddressSpace::Uniform => 'u',
                    AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => 'w',
                    AddressSpace::Storage { .. } => 'r',
                    other => panic!("{name}: {other:?}"),
                };
                Some((binding.binding, kind))
            })
            .collect();
        found.sort_unstable();
        let numbers: Vec<u32> = found.iter().map(|&(number, _)| number).collect();
        assert_eq!(numbers, (0..found.len() as u32).collect::<Vec<_>>(), "{name}");
        assert_eq!(
            found.iter().map(|&(_, kind)| kind).collect::<String>(),
            expected_bindings(shader),
            "{name}"
        );
    }
}

/// What `kernel.rs` relies on, where it tells the graphics interface not to count turns.
#[test]
fn loops_that_are_not_watched_count_up_to_a_bound_in_constant_steps() {
    for made in made().filter(|made| made.shader.has_counting_loops()) {
        let source = made.shader.source(made.matrix, made.factors);
        let code: String = source
            .lines()
            .map(|line| line.split("//").next().unwrap_or_default())
            .collect::<Vec<_>>()
            .join("\n");
        for word in ["while", "loop", "continuing", "continue"] {
            assert!(
                !code.split(|c: char| !c.is_alphanumeric()).any(|found| found == word),
                "{made:?}: {word}"
            );
        }
        let headers: Vec<&str> =
            code.match_indices("for (").map(|(at, _)| code[at + 5..].split(") {").next().unwrap()).collect();
        assert!(!headers.is_empty(), "{made:?}");
        for header in headers {
            let [begun, bound, step] = header.split("; ").collect::<Vec<_>>()[..] else {
                panic!("{made:?}: {header}");
            };
            let name = begun.strip_prefix("var ").and_then(|begun| begun.split(' ').next()).unwrap();
            assert!(bound.starts_with(&format!("{name} < ")), "{made:?}: {header}");
            let step =
                step.strip_prefix(&format!("{name} += ")).unwrap_or_else(|| panic!("{made:?}: {header}"));
            let is_constant = !step.is_empty() && step.chars().all(|c| c.is_ascii_uppercase() || c == '_');
            let is_number = step.strip_suffix('u').is_some_and(|n| n.parse::<u32>().is_ok_and(|n| n > 0));
            assert!(is_constant || is_number, "{made:?}: {header}");
            // Nothing but the header changes it, and nothing its bound.
            let base = bound.rsplit(' ').next().unwrap().split('.').next().unwrap();
            assert!(!code.contains(&format!("var {base} ")), "{made:?}: {header}");
            for operator in ["=", "+=", "-=", "*=", "/=", "%=", "<<=", ">>=", "|=", "&=", "^="] {
                let changes = |before: &str| code.matches(&format!("{before} {name} {operator} ")).count();
                assert_eq!(changes(""), changes("(var") + changes(";"), "{made:?}: {name} {operator}");
            }
        }
    }
}

#[test]
fn workgroup_memory_fits_every_adapter() {
    // WebGPU guarantees 16 KiB; adapters are asked for what matrix units need.
    for (name, made, module, _) in modules() {
        let bytes: u32 = module
            .global_variables
            .iter()
            .filter(|(_, variable)| variable.space == AddressSpace::WorkGroup)
            .map(|(_, variable)| module.types[variable.ty].inner.size(module.to_ctx()))
            .sum();
        match made.factors {
            Factors::Fragments(_) => assert_eq!(bytes, FRAGMENTS_MEMORY, "{name}"),
            _ => assert!(bytes <= 16 << 10, "{name}: {bytes} bytes"),
        }
    }
}

/// Name, size and the fields' offsets of a block, as Rust has them.
macro_rules! block {
    ($block:ident: $($field:ident),+) => {
        (stringify!($block), size_of::<$block>(), vec![$((stringify!($field), offset_of!($block, $field))),+])
    };
}

#[test]
fn uniform_blocks_have_the_same_size_and_offsets_in_rust_and_wgsl() {
    let blocks = [
        block!(Batch: rows, padded_rows, slice_rows, slices),
        block!(Layer: inputs, outputs, weights, biases, stride, upstream, parameters, omega),
        block!(Placement: stride, offset, columns, inputs),
        block!(
            Step: inverse_count, scale, learnt, loss, slot, first, learning_rate, beta1, one_minus_beta1, beta2, one_minus_beta2,
            correction1, correction2, matrix_correction, epsilon, weight_decay
        ),
        block!(Span: first, end),
        block!(Between: rows, columns, kept, one_minus_kept),
        block!(MatrixPlace: weights, columns, length),
        block!(Product: rows, columns, inner, left_transposed, right_transposed, kept, share),
        block!(Panel: first, end, behind, backwards),
        block!(Side: size, split, gap, stride),
        block!(World: low, high, origin, size),
        block!(Descent: first_weights, first_stride, neurons, skip_weights, skip_stride, skip_neurons),
        block!(Symmetry: plane_x, plane_y, plane_z, through_x, through_y, through_z, along, blunt),
        block!(PlaceFrame: cosine, sine, mirrored),
        block!(Turns: count, factor, summand),
        block!(Harmonics: degree, stride),
        block!(Lattice: nx, ny, nz, stride, columns, pitch),
        block!(Thresholds: free_up_to, colliding_from),
        block!(Sweep: base, points, directions, first_direction),
        block!(
            Counting: planes, lead_bits, plane_bits, line_bits, jobs, groups, lines, lower_x, lower_y, lower_z, nx, ny,
            nz
        ),
        block!(
            Job: axis, upwards, lower_x, lower_y, lower_z, nx, ny, nz, differences, covered_first, covered_planes,
            covered_starts, uncovered_first, uncovered_planes, uncovered_starts, shares, orientation
        ),
    ];
    for (name, _, module, _) in modules() {
        for (block, size, fields) in &blocks {
            let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(block));
            let Some((_, naga::Type { inner: TypeInner::Struct { members, span }, .. })) = found else {
                panic!("{name} has no block {block}");
            };
            assert_eq!(*span as usize, *size, "{name}: {block}");
            let offsets: Vec<(&str, usize)> = members
                .iter()
                .map(|member| (member.name.as_deref().unwrap_or(""), member.offset as usize))
                .collect();
            assert_eq!(&offsets, fields, "{name}: {block}");
        }
    }
}

#[test]
fn every_shader_translates_to_metal_direct3d_and_vulkan() {
    for (name, made, module, info) in modules() {
        let msl = naga::back::msl::Options {
            lang_version: (2, 4),
            fake_missing_bindings: true,
            ..Default::default()
        };
        let (text, _) = naga::back::msl::write_string(&module, &info, &msl, &Default::default())
            .unwrap_or_else(|error| panic!("{name}: MSL: {error}"));
        assert!(text.contains("kernel void"), "{name}");

        // Direct3D has no cooperative matrices; its adapters do not offer them.
        if !matches!(made.factors, Factors::Fragments(_)) {
            let mut text = String::new();
            let hlsl = naga::back::hlsl::Options {
                fake_missing_bindings: true,
                shader_model: naga::back::hlsl::ShaderModel::V6_2,
                ..naga::back::hlsl::Options::default()
            };
            naga::back::hlsl::Writer::new(&mut text, &hlsl, &Default::default())
                .write(&module, &info, None)
                .unwrap_or_else(|error| panic!("{name}: HLSL: {error}"));
            assert!(text.contains("numthreads"), "{name}");
        }

        let words = naga::back::spv::write_vec(&module, &info, &naga::back::spv::Options::default(), None)
            .unwrap_or_else(|error| panic!("{name}: SPIR-V: {error}"));
        assert_eq!(words[0], 0x0723_0203, "{name}: SPIR-V's magic number");
    }
}
