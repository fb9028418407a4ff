/* Answers poses by a field of imf.
 *
 *     poses FIELD.safetensors < poses.txt
 *
 * Every line of the input is a pose: x y z of the tool's tip and i j k of its axis, from tip to holder. The first line of
 * the output says what the model's values are and how far they go. Every further line answers a pose: the model's value and its gradient by position and by direction, the exact overlap, whether the
 * pose is proven free, and which of all poses' orientations is best at its point with the measure there. A last line tells
 * of the straight motion from the first to the last pose.
 *
 *     cc -I include examples/poses.c -L ../../target/release -limf_c -o poses
 *     LD_LIBRARY_PATH=../../target/release ./poses FIELD.safetensors < poses.txt
 */
#include <stdio.h>
#include <stdlib.h>

#include "imf.h"

static void require(ImfStatus status) {
    if (status != IMF_STATUS_OK) {
        fprintf(stderr, "poses: %s\n", imf_last_error());
        exit(1);
    }
}

static void *room(size_t count, size_t size) {
    void *memory = calloc(count > 0 ? count : 1, size);
    if (memory == NULL) {
        fprintf(stderr, "poses: out of memory\n");
        exit(1);
    }
    return memory;
}

static const char *name(ImfDecision decision) {
    switch (decision) {
    case IMF_DECISION_FREE:
        return "free";
    case IMF_DECISION_COLLIDING:
        return "colliding";
    case IMF_DECISION_UNDECIDED:
        return "undecided";
    }
    return "unknown";
}

int main(int count_of_arguments, char **arguments) {
    if (count_of_arguments != 2) {
        fprintf(stderr, "usage: poses FIELD.safetensors < poses.txt\n");
        return 2;
    }
    ImfField *verified = NULL, *exact = NULL;
    require(imf_open_verified(arguments[1], &verified));
    require(imf_open_exact(arguments[1], &exact));

    ImfInfo info;
    require(imf_info(verified, &info));
    printf("%s %.9g %.9g\n", info.quantity == IMF_QUANTITY_DEPTH ? "depth" : "overlap", info.bounds[0],
           info.bounds[1]);

    size_t count = 0, capacity = 64;
    ImfPose *poses = room(capacity, sizeof *poses);
    double n[6];
    while (scanf("%lf %lf %lf %lf %lf %lf", &n[0], &n[1], &n[2], &n[3], &n[4], &n[5]) == 6) {
        if (count == capacity) {
            capacity *= 2;
            poses = realloc(poses, capacity * sizeof *poses);
            if (poses == NULL) {
                fprintf(stderr, "poses: out of memory\n");
                return 1;
            }
        }
        poses[count++] = imf_pose_along(n[0], n[1], n[2], n[3], n[4], n[5]);
    }

    ImfGradient *gradients = room(count, sizeof *gradients);
    float *counted = room(count, sizeof *counted);
    ImfDecision *decisions = room(count, sizeof *decisions);
    double *points = room(count, 3 * sizeof *points), *rotations = room(count, 4 * sizeof *rotations);
    ImfBest *best = room(count, sizeof *best);
    for (size_t i = 0; i < count; i++) {
        for (int axis = 0; axis < 3; axis++) {
            points[3 * i + axis] = poses[i].position[axis];
        }
        for (int part = 0; part < 4; part++) {
            rotations[4 * i + part] = poses[i].rotation[part];
        }
    }
    require(imf_gradients(verified, poses, count, gradients));
    require(imf_values(exact, poses, count, counted));
    require(imf_classify(verified, poses, count, decisions));
    require(imf_best(verified, points, count, rotations, count, best));

    /* Nine digits tell every float from its neighbours. */
    for (size_t i = 0; i < count; i++) {
        const ImfGradient *g = &gradients[i];
        printf("%.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %s %u %.9g\n", g->value, g->position[0],
               g->position[1], g->position[2], g->direction[0], g->direction[1], g->direction[2],
               counted[i], name(decisions[i]), best[i].orientation, best[i].value);
    }
    if (count > 0) {
        ImfMotion motion;
        require(imf_check_motion(verified, &poses[0], &poses[count - 1], &motion));
        printf("motion %d %.17g %.17g\n", (int)motion.kind, motion.free_until, motion.until);
    }

    free(best);
    free(rotations);
    free(points);
    free(decisions);
    free(counted);
    free(gradients);
    free(poses);
    imf_close(exact);
    imf_close(verified);
    return 0;
}
