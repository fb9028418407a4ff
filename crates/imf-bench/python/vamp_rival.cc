// A rival of `imf-bench query`: is one of the points in one of the tool's balls, by the headers that vamp-planner installs.
//
// Its calls from Python copy the whole cloud and take the package's robots alone; this is the check its planners make, with
// the balls of one pose side by side in the lanes.

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <utility>
#include <vector>

#include <vamp/collision/environment.hh>
#include <vamp/collision/validity.hh>
#include <vamp/vector.hh>

namespace
{
    constexpr std::size_t Lanes = vamp::FloatVectorWidth;
    constexpr std::size_t Batch = 20;
    constexpr int Rounds = 3;
    using Floats = vamp::FloatVector<Lanes>;

    struct Pose
    {
        float tip[3], axis[3];
    };

    struct Ball
    {
        float height, radius;
    };

    // Balls of about one size, for which the cloud is prepared.
    struct Group
    {
        vamp::collision::Environment<Floats> environment;
        std::vector<std::pair<Floats, Floats>> balls;
    };

    auto collides(const std::vector<Group> &groups, const Pose &pose) -> bool
    {
        const auto [tip, axis] = pose;
        for (const auto &group : groups)
        {
            for (const auto &[heights, radii] : group.balls)
            {
                const Floats x = heights * axis[0] + tip[0];
                const Floats y = heights * axis[1] + tip[1];
                const Floats z = heights * axis[2] + tip[2];
                if (vamp::sphere_environment_in_collision(group.environment, x, y, z, radii))
                {
                    return true;
                }
            }
        }

        return false;
    }
}  // namespace

// Seconds for all poses: the sum over batches of the least of some rounds. The balls come with the widest first.
extern "C" auto ask(
    const vamp::collision::Point *points,
    std::size_t point_count,
    const Ball *balls,
    std::size_t ball_count,
    const Pose *poses,
    std::size_t pose_count,
    bool *colliding) -> double
{
    const std::vector<vamp::collision::Point> cloud(points, points + point_count);
    std::vector<Group> groups;
    for (std::size_t first = 0; first < ball_count;)
    {
        std::size_t end = first + 1;
        while (end < ball_count and balls[end].radius > 0.9F * balls[first].radius)
        {
            ++end;
        }

        auto &group = groups.emplace_back();
        group.environment.pointclouds.emplace_back(cloud, balls[end - 1].radius, balls[first].radius, 0.F);
        for (; first < end; first += Lanes)
        {
            alignas(vamp::FloatVectorAlignment) std::array<float, Lanes> heights, radii;
            for (std::size_t lane = 0; lane < Lanes; ++lane)
            {
                const auto &ball = balls[std::min(first + lane, end - 1)];
                heights[lane] = ball.height;
                radii[lane] = ball.radius;
            }

            group.balls.emplace_back(Floats(heights.data()), Floats(radii.data()));
        }

        first = end;
    }

    double seconds = 0;
    for (std::size_t from = 0; from < pose_count; from += Batch)
    {
        double least = 1e300;
        for (int round = 0; round < Rounds; ++round)
        {
            const auto begun = std::chrono::steady_clock::now();
            for (std::size_t i = from; i < std::min(from + Batch, pose_count); ++i)
            {
                colliding[i] = collides(groups, poses[i]);
            }

            const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begun;
            least = std::min(least, taken.count());
        }

        seconds += least;
    }

    return seconds;
}
