//! What can be said about the shaders without an adapter: they are valid, their uniform blocks are Rust's, their
//! bindings are as they should be, and naga writes each of them for Metal, Direct3D and Vulkan. And their sine, on the adapter.

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess, TypeInner};

use super::*;
use crate::adapter::DeviceChoice;
use crate::device::Gpu;
use crate::kernel::{Extent, Kernel};
use crate::memory::allocate;
use crate::uniforms::{Batch, layouts};

/// What a shader is variant for.
#[derive(Clone, Copy, Debug)]
struct Variant {
    shader: Shader,
    matrix: MatrixKernel,
    half: bool,
}

/// Every shader with every matrix kernel and its factors.
fn variants() -> impl Iterator<Item = Variant> {
    let ways = MatrixKernel::ALL.into_iter().flat_map(|matrix| [(matrix, false), (matrix, true)]);
    ways.flat_map(|(matrix, half)| {
        let shaders = Shader::ALL.iter().filter(move |shader| !half || shader.is_product());
        shaders.map(move |&shader| Variant { shader, matrix, half })
    })
}

/// All of them, parsed, and validated against what they need and no more.
fn modules() -> impl Iterator<Item = (String, Variant, Module, ModuleInfo)> {
    variants().map(|variant| {
        let name = format!("{variant:?}");
        let source = variant.shader.source(variant.matrix, variant.half);
        let module = naga::front::wgsl::parse_str(&source)
            .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(&source)));
        let capabilities = match variant.half {
            true => Capabilities::SHADER_FLOAT16 | Capabilities::SHADER_FLOAT16_IN_FLOAT32,
            false => Capabilities::empty(),
        };
        let info = Validator::new(ValidationFlags::all(), capabilities)
            .validate(&module)
            .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(&source)));
        (name, variant, module, info)
    })
}

#[test]
fn the_constants_of_the_page_are_these() {
    let stored = include_str!("../../../imf-web/page/prelude.wgsl");
    assert_eq!(stored, prelude(), "put these into crates/imf-web/page/prelude.wgsl");
}

#[test]
fn every_shader_is_valid_and_has_one_entry_point() {
    for (name, variant, module, _) in modules() {
        assert_eq!(module.entry_points.len(), 1, "{name}");
        let entry = &module.entry_points[0];
        assert_eq!(entry.name, "main", "{name}");
        let expected = match (variant.shader.is_product(), variant.matrix) {
            (false, _) if variant.shader == Shader::SoapPanel => [SOAP_GROUP, 1, 1],
            (false, _) => [LINEAR_GROUP, 1, 1],
            (true, MatrixKernel::Register) => [REGISTER_GROUP, REGISTER_GROUP, 1],
            (true, MatrixKernel::Tiled) => [TILED_GROUP, TILED_GROUP, 1],
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
        Shader::CountMinimum => "urrrww",
        Shader::MultiplyAdds => "uw",
    }
}

#[test]
fn bindings_and_their_access_are_as_the_engine_binds_them() {
    for (name, Variant { shader, .. }, module, _) in modules() {
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
    for variant in variants().filter(|variant| variant.shader.has_counting_loops()) {
        let source = variant.shader.source(variant.matrix, variant.half);
        let code: String = source
            .lines()
            .map(|line| line.split("//").next().unwrap_or_default())
            .collect::<Vec<_>>()
            .join("\n");
        for word in ["while", "loop", "continuing", "continue"] {
            assert!(
                !code.split(|c: char| !c.is_alphanumeric()).any(|found| found == word),
                "{variant:?}: {word}"
            );
        }
        let headers: Vec<&str> =
            code.match_indices("for (").map(|(at, _)| code[at + 5..].split(") {").next().unwrap()).collect();
        assert!(!headers.is_empty(), "{variant:?}");
        for header in headers {
            let [begun, bound, step] = header.split("; ").collect::<Vec<_>>()[..] else {
                panic!("{variant:?}: {header}");
            };
            let name = begun.strip_prefix("var ").and_then(|begun| begun.split(' ').next()).unwrap();
            assert!(bound.starts_with(&format!("{name} < ")), "{variant:?}: {header}");
            let step =
                step.strip_prefix(&format!("{name} += ")).unwrap_or_else(|| panic!("{variant:?}: {header}"));
            let is_constant = !step.is_empty() && step.chars().all(|c| c.is_ascii_uppercase() || c == '_');
            let is_number = step.strip_suffix('u').is_some_and(|n| n.parse::<u32>().is_ok_and(|n| n > 0));
            assert!(is_constant || is_number, "{variant:?}: {header}");
            // Nothing but the header changes it, and nothing its bound.
            let base = bound.rsplit(' ').next().unwrap().split('.').next().unwrap();
            assert!(!code.contains(&format!("var {base} ")), "{variant:?}: {header}");
            for operator in ["=", "+=", "-=", "*=", "/=", "%=", "<<=", ">>=", "|=", "&=", "^="] {
                let changes = |before: &str| code.matches(&format!("{before} {name} {operator} ")).count();
                assert_eq!(changes(""), changes("(var") + changes(";"), "{variant:?}: {name} {operator}");
            }
        }
    }
}

#[test]
fn workgroup_memory_fits_every_adapter() {
    // WebGPU guarantees 16 KiB.
    for (name, _, module, _) in modules() {
        let bytes: u32 = module
            .global_variables
            .iter()
            .filter(|(_, variable)| variable.space == AddressSpace::WorkGroup)
            .map(|(_, variable)| module.types[variable.ty].inner.size(module.to_ctx()))
            .sum();
        assert!(bytes <= 16 << 10, "{name}: {bytes} bytes");
    }
}

#[test]
fn uniform_blocks_have_the_same_size_and_offsets_in_rust_and_wgsl() {
    let blocks = layouts();
    for (name, _, module, _) in modules() {
        for (block, size, fields) in &blocks {
            let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(*block));
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
    for (name, _, module, info) in modules() {
        let msl = naga::back::msl::Options {
            lang_version: (2, 4),
            fake_missing_bindings: true,
            ..Default::default()
        };
        let (text, _) = naga::back::msl::write_string(&module, &info, &msl, &Default::default())
            .unwrap_or_else(|error| panic!("{name}: MSL: {error}"));
        assert!(text.contains("kernel void"), "{name}");

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

        let words = naga::back::spv::write_vec(&module, &info, &naga::back::spv::Options::default(), None)
            .unwrap_or_else(|error| panic!("{name}: SPIR-V: {error}"));
        assert_eq!(words[0], 0x0723_0203, "{name}: SPIR-V's magic number");
    }
}

/// One invocation takes four angles.
const PROBE: &str = "
@group(0) @binding(0) var<storage, read> angles: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> sines: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> cosines: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&angles) {
        let result = sine_cosine(angles[id.x]);
        sines[id.x] = result.sine;
        cosines[id.x] = result.cosine;
    }
}
";

/// Rounding of the reduced angle, of the polynomial's sums and of the result: 9.1e-8 on lavapipe, with room for a device that
/// contracts sums differently.
const TOLERANCE: f64 = 3e-7;

#[test]
#[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
fn sine_and_cosine_are_good_to_three_tenths_of_a_millionth() {
    let gpu = Gpu::open(&DeviceChoice::Any).unwrap();
    let mut angles: Vec<f32> = (0..200_000).map(|i| (i as f32 - 100_000.0) * 0.010_007).collect();
    // Around multiples of π/2, where the reduction cancels most.
    for n in -636..=636 {
        let at = (f64::from(n) * std::f64::consts::FRAC_PI_2) as f32;
        angles.extend([at, at.next_up(), at.next_down(), at + 1e-4]);
    }
    angles.extend([0.0, -0.0, 1e-20, f32::MIN_POSITIVE]);
    let count = angles.len();
    let [input, sines, cosines] =
        allocate(&gpu, ["angles", "sines", "cosines"].map(|name| (name, count))).unwrap();
    gpu.write(&input, &angles);
    let source = format!("{}{PROBE}", include_str!("../../../../shaders/sine.wgsl"));
    let probe = Kernel::of_source(&gpu, "probe".to_owned(), source, false).unwrap();
    let probe = probe.bind(Extent::Sliced(count / 4), &[&input, &sines, &cosines]);
    gpu.run([&probe], Batch { slices: 1, ..Batch::default() }).unwrap();
    let [sines, cosines] = [sines, cosines].map(|buffer| gpu.read::<f32>(&buffer, count).unwrap());
    let mut worst = (0.0, 0.0);
    for ((&x, &sine), &cosine) in angles.iter().zip(&sines).zip(&cosines) {
        let x = f64::from(x);
        let error = (f64::from(sine) - x.sin()).abs().max((f64::from(cosine) - x.cos()).abs());
        if error > worst.0 || error.is_nan() {
            worst = (error, x);
        }
    }
    println!("largest error {:.2e} at {}", worst.0, worst.1);
    assert!(worst.0 <= TOLERANCE, "error {} at {}", worst.0, worst.1);
}
