// Where, and from which directions, a tool reaches a part without collision: the C interface of imf.
//
// A field is opened from a file that imf wrote, asked about any number of poses, and closed:
//
//     ImfField *field = NULL;
//     if (imf_open_verified("field.safetensors", &field) != IMF_STATUS_OK) {
//         fprintf(stderr, "%s\n", imf_last_error());
//         return 1;
//     }
//     ImfPose pose = imf_pose_along(10.0, 20.0, 30.0, 0.0, 0.0, 1.0);
//     ImfDecision decision;
//     imf_classify(field, &pose, 1, &decision);
//     imf_close(field);
//
// Lengths are in the unit of the field's scene (imf_info). Several threads may call with one field at once; it must not be
// closed while one does. imf_last_error says why a call failed; what it has written until then means nothing. Pointers must
// be aligned and point to as many elements as the call says; what is read and what is written must not overlap. A pointer to no
// element (a count of 0) may be NULL.
//
// Generated from crates/imf-c/src by cbindgen; do not edit.

#ifndef IMF_H
#define IMF_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

// What became of a call.
typedef enum {
  // It is done.
  IMF_STATUS_OK = 0,
  // A pointer that must not be NULL is.
  IMF_STATUS_NULL_POINTER = 1,
  // An argument that cannot be: a misaligned pointer, an absurd count, no orientation, a path that is no UTF-8.
  IMF_STATUS_ARGUMENT = 2,
  // The file is missing, foreign, newer, damaged, or its tool cannot be used.
  IMF_STATUS_FILE = 3,
  // This kind of field does not answer that.
  IMF_STATUS_UNSUPPORTED = 4,
  // The question has no answer: an end of a motion that is an invalid pose, a tool that holds no voxel.
  IMF_STATUS_NO_ANSWER = 5,
  // A defect of the library, caught. The field may be asked on.
  IMF_STATUS_DEFECT = 6,
} ImfStatus;

// What a field's values are. Either falls towards freedom.
typedef enum {
  // The fraction of the tool's volume that lies in the obstacle, 0 to 1.
  IMF_QUANTITY_OVERLAP = 0,
  // How far the tool must be moved to be free, in the scene's unit; below 0 how far it may be moved. Clamped within eight
  // pitches.
  IMF_QUANTITY_DEPTH = 1,
} ImfQuantity;

// Whether the tool collides.
typedef enum {
  // It does not.
  IMF_DECISION_FREE = 0,
  // It does; or the pose is none.
  IMF_DECISION_COLLIDING = 1,
  // Too close to tell: an exact or verified field must decide.
  IMF_DECISION_UNDECIDED = 2,
} ImfDecision;

// What is known of a motion.
typedef enum {
  // No pose of it collides.
  IMF_MOTION_KIND_FREE = 0,
  // A pose of it collides.
  IMF_MOTION_KIND_COLLIDING = 1,
} ImfMotionKind;

// A field, opened from a file.
typedef struct ImfField ImfField;

// Where the tool is.
typedef struct {
  // Position of the tool's tip in the world.
  double position[3];
  // Rotation from the tool's frame (tip at the origin, axis +z from tip to holder) to the world: a quaternion x, y, z, w of
  // any length but 0. The roll about the tool's axis is idle for tools of revolution.
  double rotation[4];
} ImfPose;

// What a field is of. Lengths are in its scene's unit.
typedef struct {
  // Lower corner of the box in which a model is known: that of the voxels' centres.
  double lower[3];
  // Upper corner of that box.
  double upper[3];
  // Edge of a voxel.
  double pitch;
  // Millimetres in one unit of length.
  double unit_in_mm;
  // Clearance by which holder, shank and cutter of the tool are offset in the file's values.
  double clearance[3];
  // True where the file has thresholds for the model's own decisions: without, it answers undecided.
  bool calibrated;
  // What its values are. An exact field's are overlaps, whatever its file's are.
  ImfQuantity quantity;
  // What no exact value of that quantity lies below and above; a model's may a little, by its error.
  double bounds[2];
} ImfInfo;

// A value and how it changes.
typedef struct {
  // The overlap, not clipped: a model's may lie a little outside 0 to 1. Of a field of depth the depth (ImfInfo.quantity).
  float value;
  // Change for a move of the tip by one unit of length.
  float position[3];
  // Change for a turn of the tool's axis by a radian: tangent to the sphere at the axis.
  float direction[3];
  // Change for a turn of the whole tool by a radian, as a vector w in the world's frame (R becomes exp(w) R).
  float rotation[3];
} ImfGradient;

// The best way to reach a point.
typedef struct {
  // The least collision measure, in 0 to 1, or the least depth (ImfInfo.quantity); NaN for a point that is not finite.
  float value;
  // Its orientation, by its place in the list: the first of equals, one that is decided free before all others.
  uint32_t orientation;
  // What is decided there.
  ImfDecision decision;
} ImfBest;

// What is known of a motion; times run from 0 at its beginning to 1 at its end.
typedef struct {
  // Which of the two.
  ImfMotionKind kind;
  // Before this time every pose is proven free. From then on, where the tool passes too closely for a proof, poses were tried between
  // which no point of the tool moves farther than a hundredth of a pitch.
  double proven_until;
  // Up to this time the motion is free; 1 where all of it is, 0 where it begins with a collision.
  double free_until;
  // The pose at that time; an invalid one (NaN) where the motion begins with a collision.
  ImfPose last_valid;
  // Colliding: time of the first pose that was found to collide. Free: 1.
  double until;
  // Colliding: the pose that collides. Else an invalid pose (NaN).
  ImfPose pose;
} ImfMotion;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The message of the last call of this thread that failed; empty before any. It stays until the thread's next failure or
// end, and is never NULL.
const char *imf_last_error(void);

// The library's version, such as "0.1.0".
const char *imf_version(void);

// The pose of a tool whose tip is at (x, y, z) and whose axis, from tip to holder, points along (i, j, k), of any length
// but 0; without roll. An axis without direction gives an invalid pose (NaN), which every field answers with NaN and colliding.
ImfPose imf_pose_along(double x,
                       double y,
                       double z,
                       double i,
                       double j,
                       double k);

// Opens a model of any family: approximate values, gradients, and decisions as good as its calibration. On failure *field
// is NULL.
//
// # Safety
// path is a text that ends with 0, in UTF-8; field has room for a pointer.
ImfStatus imf_open_model(const char *path,
                         ImfField **field);

// Opens a model whose decisions are proven: free only where no solid voxel's centre lies in the scene's true tool. Values
// and gradients are the model's. On failure *field is NULL.
//
// # Safety
// path is a text that ends with 0, in UTF-8; field has room for a pointer.
ImfStatus imf_open_verified(const char *path,
                            ImfField **field);

// As imf_open_verified, for the true tool offset by the clearance that the file was made with. On failure *field is NULL.
//
// # Safety
// path is a text that ends with 0, in UTF-8; field has room for a pointer.
ImfStatus imf_open_verified_with_clearance(const char *path,
                                           ImfField **field);

// Opens the exact field of the scene in a model's file: voxels are counted in the scene's tool, offset by the file's
// clearance where it has one; the model itself is not used. On failure *field is NULL.
//
// # Safety
// path is a text that ends with 0, in UTF-8; field has room for a pointer.
ImfStatus imf_open_exact(const char *path,
                         ImfField **field);

// What the field is of.
//
// # Safety
// field was opened and not closed; info has room for one.
ImfStatus imf_info(const ImfField *field, ImfInfo *info);

// Closes a field; NULL is passed over.
//
// # Safety
// field is NULL, or was opened, not closed yet, and no thread calls with it any more.
void imf_close(ImfField *field);

// The overlap, 0 to 1, of every pose: the fraction of the tool's volume that lies in the obstacle; of a field of depth the depth
// (ImfInfo.quantity). NaN for invalid poses.
//
// # Safety
// field was opened and not closed; there are count poses, and room for as many values.
ImfStatus imf_values(const ImfField *field,
                     const ImfPose *poses,
                     size_t count,
                     float *values);

// The values of imf_values, but overlaps not clipped, with their derivatives. Those of an exact field, whose values are steps,
// are differences over a voxel's width.
//
// # Safety
// field was opened and not closed; there are count poses, and room for as many gradients.
ImfStatus imf_gradients(const ImfField *field,
                        const ImfPose *poses,
                        size_t count,
                        ImfGradient *gradients);

// Whether the tool collides at every pose. Exact and verified fields decide every pose; a model answers undecided where its
// calibration leaves it open, and everywhere outside its box.
//
// # Safety
// field was opened and not closed; there are count poses, and room for as many decisions.
ImfStatus imf_classify(const ImfField *field,
                       const ImfPose *poses,
                       size_t count,
                       ImfDecision *decisions);

// The inaccessibility measure with the best orientation of every point: points are x, y, z, three numbers each; rotations are
// quaternions x, y, z, w, four numbers each, at least one. Takes memory for a copy of both for the time of the call.
//
// # Safety
// field was opened and not closed; there are 3 * point_count numbers of points, 4 * rotation_count of rotations, and room for
// point_count answers.
ImfStatus imf_best(const ImfField *field,
                   const double *points,
                   size_t point_count,
                   const double *rotations,
                   size_t rotation_count,
                   ImfBest *best);

// Whether the tool may move from a to b: the tip along the straight line, the axis along the great circle, both evenly.
// Exact and verified fields answer it.
//
// # Safety
// field was opened and not closed; a and b are poses; motion has room for one.
ImfStatus imf_check_motion(const ImfField *field,
                           const ImfPose *a,
                           const ImfPose *b,
                           ImfMotion *motion);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* IMF_H */
