//! What calls from slices of the host work with: buffers that are reused from call to call, and grow.

use imf_core::field::EngineError;
use imf_core::pose::Pose;

use super::device_types::{DeviceGradient, DevicePose};
use super::passes::Call;
use crate::device::Gpu;
use crate::memory::Room;

/// Poses that go up in one piece, for which the graphics interface makes and drops memory of its own: 256 KiB.
const PIECE: usize = 1 << 13;

/// Buffers for the poses of one call and their results.
pub(super) struct HostBuffers {
    staged: Vec<DevicePose>,
    poses: Room,
    values: Room,
    gradients: Room,
}

impl HostBuffers {
    pub(super) fn new() -> Self {
        Self {
            staged: Vec::new(),
            poses: Room::new("poses"),
            values: Room::new("values of poses"),
            gradients: Room::new("gradients of poses"),
        }
    }

    /// Poses on the device, and room for their values and, if wanted, gradients.
    pub(super) fn upload(
        &mut self,
        gpu: &Gpu,
        poses: &[Pose],
        with_gradients: bool,
    ) -> Result<Call, EngineError> {
        let elements = |bytes: usize| poses.len() * bytes / 4;
        let uploaded = self.poses.fit(gpu, elements(size_of::<DevicePose>()))?;
        for (piece, poses) in poses.chunks(PIECE).enumerate() {
            self.staged.clear();
            self.staged.extend(poses.iter().map(|&pose| DevicePose::from(pose)));
            let offset = (piece * PIECE * size_of::<DevicePose>()) as u64;
            gpu.queue().write_buffer(&uploaded, offset, bytemuck::cast_slice(&self.staged));
        }
        let room = with_gradients.then(|| self.gradients.fit(gpu, elements(size_of::<DeviceGradient>())));
        Ok(Call { poses: uploaded, values: self.values.fit(gpu, poses.len())?, gradients: room.transpose()? })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::adapter::DeviceChoice;

    #[test]
    #[cfg_attr(no_gpu_tests, ignore = "IMF_NO_GPU_TESTS is set")]
    fn buffers_are_kept_until_more_is_asked() {
        let gpu = Gpu::open(&DeviceChoice::Any).unwrap();
        let mut host = HostBuffers::new();
        let buffers = |host: &mut HostBuffers, count: usize| {
            // More than one piece.
            let poses: Vec<Pose> =
                (0..count).map(|place| Pose::along(DVec3::splat(place as f64), DVec3::X)).collect();
            let up = host.upload(&gpu, &poses, true).unwrap();
            let mut seen = 0;
            let expected = |place: usize| DevicePose::from(poses[place]);
            gpu.read_each(&up.poses, count, |place, pose: DevicePose| {
                assert!(pose == expected(place) && place == seen);
                seen += 1;
            })
            .unwrap();
            assert_eq!(seen, count);
            (up.poses, up.values, up.gradients, gpu.staging.lock().unwrap().clone())
        };
        let first = buffers(&mut host, 20_000);
        assert!(buffers(&mut host, 20_000) == first && buffers(&mut host, 3) == first);
        let grown = buffers(&mut host, 70_000);
        assert!(grown.0 != first.0 && grown.1 != first.1 && grown.2 != first.2 && grown.3 != first.3);
        assert!(buffers(&mut host, 20_000) == grown);
    }
}
