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
// What a world's or a checker's first questions need is made by several threads, and threads do not survive a fork: fork before
// the first call, and let each process make its own.
//
// Generated from crates/imf-c/src by cbindgen; do not edit.

#ifndef IMF_H
#define IMF_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

// Of this header; imf_version() is that of the library.
#define IMF_VERSION "0.1.0"
#define IMF_VERSION_MAJOR 0
#define IMF_VERSION_MINOR 1
#define IMF_VERSION_PATCH 0

// What became of a call.
typedef enum {
  // It is done.
  IMF_STATUS_OK = 0,
  // A pointer that must not be NULL is.
  IMF_STATUS_NULL_POINTER = 1,
  // An argument that cannot be: a misaligned pointer, an absurd count, no orientation, a path that is not UTF-8.
  IMF_STATUS_ARGUMENT = 2,
  // The file is missing, foreign, newer, damaged, or its tool cannot be used.
  IMF_STATUS_FILE = 3,
  // This kind of field, or this tool, does not support the query.
  IMF_STATUS_UNSUPPORTED = 4,
  // The query has no result: a pose that is invalid or too far from an obstacle, ends of a motion whose axes are opposite, a tool that
  // holds no voxel.
  IMF_STATUS_NO_ANSWER = 5,
  // A defect of the library, caught. The field can still be used. Memory that is not there is none: it ends the process, so that whoever
  // asks for a pitch estimates the voxels, of some 20 bytes each.
  IMF_STATUS_DEFECT = 6,
} ImfStatus;

// What a field's values are. Either falls towards freedom.
typedef enum {
  // The fraction of the tool's volume that lies in the obstacle, 0 to 1.
  IMF_QUANTITY_OVERLAP = 0,
  // How far the tool must be moved to be free, in the scene's unit; below 0 how far it may be moved. Clamped within 7.5
  // pitches.
  IMF_QUANTITY_DEPTH = 1,
} ImfQuantity;

// Whether the tool collides.
typedef enum {
  // It does not.
  IMF_DECISION_FREE = 0,
  // It does; or the pose is invalid.
  IMF_DECISION_COLLIDING = 1,
  // Too close to tell: an exact or verified field must decide.
  IMF_DECISION_UNDECIDED = 2,
} ImfDecision;

// What is known of a motion.
typedef enum {
  // No pose of it was found to collide; where proven_until is 1 none does.
  IMF_MOTION_KIND_FREE = 0,
  // A pose of it collides.
  IMF_MOTION_KIND_COLLIDING = 1,
} ImfMotionKind;

// A unit of length.
typedef enum {
  // Millimetre.
  IMF_UNIT_MM = 0,
  // Centimetre.
  IMF_UNIT_CM = 1,
  // Metre.
  IMF_UNIT_M = 2,
  // Inch.
  IMF_UNIT_INCH = 3,
} ImfUnit;

// One tool among the obstacles of a world, with a clearance.
typedef struct ImfChecker ImfChecker;

// A field, opened from a file.
typedef struct ImfField ImfField;

// Obstacles with their places.
typedef struct ImfWorld ImfWorld;

// Where the tool is.
typedef struct {
  // Position of the tool's tip in the world.
  double position[3];
  // Rotation from the tool's frame (tip at the origin, axis +z from tip to holder) to the world: a quaternion x, y, z, w of
  // any length from 1e-150 to 1e150. The roll about the tool's axis is idle for tools of revolution.
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
  // How deep below the part's surface the cutter may reach; 0 for not at all. Voxels of the part whose centres lie no deeper are no
  // obstacle to it, in values, decisions and proofs alike.
  double contact;
  // True where the file has thresholds for the model's own decisions: without, it returns undecided.
  bool calibrated;
  // What its values are. An exact field's are overlaps, whatever its file's are.
  ImfQuantity quantity;
  // What no exact value of that quantity lies below and above; a model's may a little, by its error.
  double bounds[2];
} ImfInfo;

// A value and how it changes.
typedef struct {
  // The value, not clipped: a model's overlap may lie a little outside 0 to 1, its depth beyond 7.5 pitches (ImfInfo.quantity).
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
  // The minimum collision measure, in 0 to 1, or the minimum depth (ImfInfo.quantity); NaN for a point that is not
  // finite.
  float value;
  // Its orientation, by its place in the list: of the least value before it is clipped the first of equals, one that is decided free
  // before all others.
  uint32_t orientation;
  // What is decided there.
  ImfDecision decision;
} ImfBest;

// The result for a motion; times run from 0 at its beginning to 1 at its end.
typedef struct {
  // Which of the two.
  ImfMotionKind kind;
  // Before this time every pose is proven free. From then on, where the tool passes too closely for a proof, poses
  // were sampled between which no point of the tool moves farther than a hundredth of a pitch, or than the given
  // resolution.
  double proven_until;
  // Up to this time the motion is free; 1 where all of it is, 0 where it begins with a collision.
  double free_until;
  // The pose at that time; an invalid one (NaN) where the motion begins with a collision.
  ImfPose last_valid;
  // Colliding: time of the first pose that was found to collide. Free: 1.
  double until;
  // Colliding: the pose that collides. Else an invalid pose (NaN).
  ImfPose pose;
  // Colliding: the element that collides: 0 the cutter, 1 the shank, 2 and more the holder's segments from the tip upwards. Else, and of a
  // mesh, -1.
  int32_t element;
  // Colliding: the number of the obstacle. Else 0.
  uint64_t obstacle;
} ImfMotion;

// A mesh that becomes an obstacle, and how.
typedef struct {
  // Its name, which ends with 0, in UTF-8.
  const char *name;
  // x, y and z of every vertex, in the mesh's own frame.
  const double *vertices;
  // How many vertices.
  size_t vertex_count;
  // Three vertices of every triangle, counter-clockwise seen from outside.
  const uint32_t *triangles;
  // How many triangles.
  size_t triangle_count;
  // From the mesh's lengths to the world's; 0 for 1.
  double scale;
  // Edge of a voxel, in the world's unit; 0 for the world's own.
  double pitch;
  // How deep below its surface the cutter may reach, in the world's unit; 0 for what is not to be cut.
  double contact;
  // Whether every voxel that the surface touches is solid; 0 for no. The tool is then free of the mesh itself where it has a clearance
  // of 0.8661 pitches all around as well (imf_checker_guarantee).
  uint8_t conservative;
} ImfMesh;

// A distance with its bounds, in the world's unit: above 0 between the tool, offset by its clearance, and the nearest solid voxel's centre, but for
// those that the cutter may hold by ImfMesh.contact; below 0 minus the shortest translation that frees the tool from the obstacle.
typedef struct {
  // The distance is at least this; infinite where there is no obstacle, and then nothing below means anything.
  double lower;
  // It is at most this.
  double upper;
  // A point of the tool's surface.
  double tool_point[3];
  // The voxel's centre to which that point is nearest.
  double obstacle_point[3];
  // The tool's element: 0 the cutter, 1 the shank, 2 and more the holder's segments from the tip upwards.
  int32_t element;
  // The number of the obstacle.
  uint64_t obstacle;
} ImfDistance;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The message of the last call of this thread that failed; empty before any. It stays until the thread's next failure or
// end, and is never NULL.
const char *imf_last_error(void);

// The library's version, such as "0.1.0".
const char *imf_version(void);

// The pose of a tool whose tip is at (x, y, z) and whose axis, from tip to holder, points along (i, j, k), of any
// length but 0; without roll. An axis without direction gives an invalid pose (NaN), for which every field returns
// NaN and colliding.
ImfPose imf_pose_along(double x,
                       double y,
                       double z,
                       double i,
                       double j,
                       double k);

// Opens a model whose decisions are proven, as imf_open_verified, from a file that is in memory; messages call it name. The bytes are not
// needed afterwards. On failure *field is NULL.
//
// # Safety
// bytes holds size bytes; name is a text that ends with 0, in UTF-8; field has room for a pointer.
ImfStatus imf_open_verified_from_memory(const uint8_t *bytes,
                                        size_t size,
                                        const char *name,
                                        ImfField **field);

// Opens a model of any family: approximate values, gradients, and decisions as good as its calibration. On failure *field
// is NULL.
//
// # Safety
// path is a text that ends with 0, in UTF-8; field has room for a pointer.
ImfStatus imf_open_model(const char *path,
                         ImfField **field);

// Opens a model whose decisions are proven: free only where no solid voxel's centre lies in the scene's true tool, but for those that the
// cutter may hold by ImfInfo.contact. Values and gradients are the model's. On failure *field is NULL.
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
// clearance where it has one, but for those that the cutter may hold by ImfInfo.contact; the model itself is not used. On failure *field is NULL.
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

// Closes a field; NULL is ignored.
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

// The values of imf_values, but not clipped, with their derivatives. Those of an exact field, whose values are steps,
// are differences over a voxel's width.
//
// # Safety
// field was opened and not closed; there are count poses, and room for as many gradients.
ImfStatus imf_gradients(const ImfField *field,
                        const ImfPose *poses,
                        size_t count,
                        ImfGradient *gradients);

// Whether the tool collides at every pose. Exact and verified fields decide every pose; a model returns undecided
// where its calibration leaves it open, and everywhere outside its box.
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
// field was opened and not closed; there are 3 * point_count numbers of points, 4 * rotation_count of rotations, and
// room for point_count results.
ImfStatus imf_best(const ImfField *field,
                   const double *points,
                   size_t point_count,
                   const double *rotations,
                   size_t rotation_count,
                   ImfBest *best);

// Whether the tool may move from a to b: the tip along the straight line, the axis along the great circle, both evenly.
// Exact and verified fields support it.
//
// # Safety
// field was opened and not closed; a and b are poses; motion has room for one.
ImfStatus imf_check_motion(const ImfField *field,
                           const ImfPose *a,
                           const ImfPose *b,
                           ImfMotion *motion);

// Makes a world without obstacles: its unit, an ImfUnit, and the edge of a voxel of obstacles that have none of their own. On failure *world is
// NULL.
//
// # Safety
// world has room for a pointer.
ImfStatus imf_world_create(uint32_t unit,
                           double pitch,
                           ImfWorld **world);

// Adds an obstacle: makes voxels of a mesh, in its own frame, which stands at a place in the world. It gets a number, by which it
// can be moved and removed.
//
// # Safety
// world was created and not closed, and no other thread calls with it; mesh is one, and holds as many numbers as it says; at is a pose; id
// has room for a number.
ImfStatus imf_world_add_mesh(ImfWorld *world,
                             const ImfMesh *mesh,
                             const ImfPose *at,
                             uint64_t *id);

// As imf_world_add_mesh, of an OBJ, STL, PLY or 3MF file; of mesh its triangles are not read. Files that state no unit are in the world's.
//
// # Safety
// As imf_world_add_mesh; path is a text that ends with 0, in UTF-8.
ImfStatus imf_world_add_file(ImfWorld *world,
                             const char *path_text,
                             const ImfMesh *mesh,
                             const ImfPose *at,
                             uint64_t *id);

// Warnings about the meshes that were added, a text for each index from 0; NULL beyond the last, and for a world
// that is NULL. They report walls that lie between the voxels' centres, through which a tool would pass undetected,
// and meshes that are not closed. A text stays until the world is closed.
//
// # Safety
// world was created and not closed, and no other thread changes it.
const char *imf_world_warning(const ImfWorld *world,
                              size_t index);

// Moves an obstacle: at is from its own frame into the world. Checkers see it once they follow.
//
// # Safety
// world was created and not closed, and no other thread calls with it; at is a pose.
ImfStatus imf_world_place(ImfWorld *world, uint64_t id, const ImfPose *at);

// Removes an obstacle. Checkers see it once they follow.
//
// # Safety
// world was created and not closed, and no other thread calls with it.
ImfStatus imf_world_remove(ImfWorld *world, uint64_t id);

// Closes a world; NULL is ignored. Checkers of it stay.
//
// # Safety
// world is NULL, or was created, not closed yet, and no thread calls with it any more.
void imf_world_close(ImfWorld *world);

// Makes a checker of a tool in a world: the tool by its file (imf's own TOML, or a library's file of one tool), offset by the clearance of
// holder, shank and cutter, in the world's unit. On failure *checker is NULL.
//
// # Safety
// world was created and not closed; tool_path is a text that ends with 0, in UTF-8; there are three clearances; checker has room for a
// pointer.
ImfStatus imf_checker_create(const ImfWorld *world,
                             const char *tool_path,
                             const double *clearance,
                             ImfChecker **checker);

// Updates the places of the world's obstacles, including added and removed ones. What was computed for those that
// remain is reused. On failure the checker stays as it was. Texts of its warnings and its guarantee go.
//
// # Safety
// checker was created and not closed, and no other thread calls with it; world was created and not closed.
ImfStatus imf_checker_follow(ImfChecker *checker,
                             const ImfWorld *world);

// Warnings about the checker's tool among its obstacles, a text for each index from 0; NULL beyond the last, and for
// a checker that is NULL. They report a tool whose tip is not at the origin, as one in another frame or unit, and a
// tip so slender that it passes between voxels' centres for a while. A text stays until the checker follows or is
// closed.
//
// # Safety
// checker was created and not closed, and no other thread changes it.
const char *imf_checker_warning(const ImfChecker *checker,
                                size_t index);

// What "free" guarantees for the meshes of the obstacles, as a text; NULL for a checker that is NULL. It stays until the checker follows
// or is closed.
//
// # Safety
// checker was created and not closed, and no other thread changes it.
const char *imf_checker_guarantee(const ImfChecker *checker);

// Whether the tool collides at every pose: free or colliding, exactly for voxel centres.
//
// # Safety
// checker was created and not closed; there are count poses, and room for as many decisions.
ImfStatus imf_checker_classify(const ImfChecker *checker,
                               const ImfPose *poses,
                               size_t count,
                               ImfDecision *decisions);

// How far the tool is from the nearest obstacle, or how deep it is in one.
//
// # Safety
// checker was created and not closed; pose is one; distance has room for one.
ImfStatus imf_checker_distance(const ImfChecker *checker,
                               const ImfPose *pose,
                               ImfDistance *distance);

// Whether the tool may move from a to b: the tip along the straight line, the axis along the great circle, both evenly. Where it passes too
// closely for a proof, poses are tried between which no point of the tool moves farther than resolution; 0 for a hundredth of the finest
// pitch.
//
// # Safety
// checker was created and not closed; a and b are poses; motion has room for one.
ImfStatus imf_checker_motion(const ImfChecker *checker,
                             const ImfPose *a,
                             const ImfPose *b,
                             double resolution,
                             ImfMotion *motion);

// Closes a checker; NULL is ignored.
//
// # Safety
// checker is NULL, or was created, not closed yet, and no thread calls with it any more.
void imf_checker_close(ImfChecker *checker);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* IMF_H */
