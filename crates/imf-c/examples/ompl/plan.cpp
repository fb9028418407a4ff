// A tool's way around a part by OMPL's RRT-Connect, twice: with imf deciding poses and motions, and with FCL deciding poses along each
// motion, as OMPL's own programs have it. The same starts, goals and bounds, each with random numbers of its own; every way that is found is looked at by the other.
//
//     plan PART.obj TOOL.toml [PROBLEMS]
//
// TOOL.toml is that beside this file, whose sizes FCL's shapes have. Debian: apt-get install libompl-dev libfcl-dev libeigen3-dev, and see
// the Makefile. A state is a tip and a rotation whose roll is idle; between two the tip goes straight and the axis along the great circle.
#include <fcl/fcl.h>
#include <ompl/base/DiscreteMotionValidator.h>
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/spaces/SE3StateSpace.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <random>
#include <sstream>
#include <string>
#include <vector>

extern "C" {
#include "imf.h"
}

namespace ob = ompl::base;
namespace og = ompl::geometric;
using Vector = Eigen::Vector3d;
using Clock = std::chrono::steady_clock;

// The tool beside this file: a ball of 10 mm, a shank up to 35 mm, a holder up to 83 mm.
constexpr double BALL = 5.0, SHANK_END = 35.0, HOLDER = 14.5, HOLDER_END = 83.0;
// Edge of imf's voxels, and how far OMPL's way of checking steps, in mm.
constexpr double PITCH = 1.0, STEP = 1.0;
// Seconds that a problem may take.
constexpr double MOST = 20.0;

static void require(ImfStatus status) {
    if (status != IMF_STATUS_OK) {
        std::fprintf(stderr, "plan: %s\n", imf_last_error());
        std::exit(1);
    }
}

struct Part {
    std::vector<Vector> vertices;
    std::vector<std::array<uint32_t, 3>> triangles;
};

static Part read_obj(const char *path) {
    std::ifstream file(path);
    Part part;
    for (std::string line; std::getline(file, line);) {
        std::istringstream words(line);
        std::string kind;
        words >> kind;
        if (kind == "v") {
            Vector v;
            words >> v.x() >> v.y() >> v.z();
            part.vertices.push_back(v);
        } else if (kind == "f") {
            std::vector<uint32_t> corners;
            for (std::string corner; words >> corner;) corners.push_back(std::stoul(corner) - 1);
            for (size_t i = 2; i < corners.size(); i++)
                part.triangles.push_back({corners[0], corners[i - 1], corners[i]});
        }
    }
    if (part.triangles.empty()) {
        std::fprintf(stderr, "plan: %s holds no triangle\n", path);
        std::exit(1);
    }
    return part;
}

// Tip and rotation, whose axis goes along the great circle.
class ToolSpace : public ob::SE3StateSpace {
  public:
    ToolSpace() { setName("tool"); }

    void interpolate(const ob::State *from, const ob::State *to, double t, ob::State *at) const override {
        const Eigen::Quaterniond a = rotation(from), b = rotation(to);
        const Vector one = a * Vector::UnitZ(), other = b * Vector::UnitZ();
        const Eigen::Quaterniond arc = Eigen::Quaterniond::FromTwoVectors(one, other);
        const Eigen::Quaterniond turned = Eigen::Quaterniond::Identity().slerp(t, arc) * a;
        const Vector tip = (1.0 - t) * position(from) + t * position(to);
        auto *out = at->as<StateType>();
        out->setXYZ(tip.x(), tip.y(), tip.z());
        out->rotation().x = turned.x();
        out->rotation().y = turned.y();
        out->rotation().z = turned.z();
        out->rotation().w = turned.w();
    }

    // How far the tip goes, and a point 50 mm above it.
    double distance(const ob::State *a, const ob::State *b) const override {
        const Vector one = rotation(a) * Vector::UnitZ(), other = rotation(b) * Vector::UnitZ();
        return (position(a) - position(b)).norm() + 50.0 * std::acos(std::clamp(one.dot(other), -1.0, 1.0));
    }

    static Vector position(const ob::State *state) {
        const auto *own = state->as<StateType>();
        return {own->getX(), own->getY(), own->getZ()};
    }

    static Eigen::Quaterniond rotation(const ob::State *state) {
        const auto &own = state->as<StateType>()->rotation();
        return Eigen::Quaterniond(own.w, own.x, own.y, own.z);
    }
};

static ImfPose pose_of(const ob::State *state) {
    const Vector tip = ToolSpace::position(state);
    const Eigen::Quaterniond turn = ToolSpace::rotation(state);
    return {{tip.x(), tip.y(), tip.z()}, {turn.x(), turn.y(), turn.z(), turn.w()}};
}

struct Count {
    size_t poses = 0, motions = 0;
};

// imf: poses by imf_checker_classify, motions by imf_checker_motion, proven or answered to a hundredth of a voxel.
class ImfValidity : public ob::StateValidityChecker {
  public:
    ImfValidity(const ob::SpaceInformationPtr &si, const ImfChecker *checker, Count *count)
        : StateValidityChecker(si), checker_(checker), count_(count) {}

    bool isValid(const ob::State *state) const override {
        const ImfPose pose = pose_of(state);
        ImfDecision decision;
        require(imf_checker_classify(checker_, &pose, 1, &decision));
        count_->poses++;
        return si_->satisfiesBounds(state) && decision == IMF_DECISION_FREE;
    }

  private:
    const ImfChecker *checker_;
    Count *count_;
};

class ImfMotions : public ob::MotionValidator {
  public:
    ImfMotions(const ob::SpaceInformationPtr &si, const ImfChecker *checker, Count *count)
        : MotionValidator(si), checker_(checker), count_(count) {}

    bool checkMotion(const ob::State *a, const ob::State *b) const override { return ask(a, b).free_until >= 1.0; }

    bool checkMotion(const ob::State *a, const ob::State *b, std::pair<ob::State *, double> &last) const override {
        const ImfMotion motion = ask(a, b);
        if (motion.free_until >= 1.0) return true;
        last.second = motion.free_until;
        if (last.first) si_->getStateSpace()->interpolate(a, b, motion.free_until, last.first);
        return false;
    }

    ImfMotion ask(const ob::State *a, const ob::State *b) const {
        const ImfPose from = pose_of(a), to = pose_of(b);
        ImfMotion motion;
        count_->motions++;
        if (imf_checker_motion(checker_, &from, &to, 0.0, &motion) != IMF_STATUS_OK) motion.free_until = 0.0;
        return motion;
    }

  private:
    const ImfChecker *checker_;
    Count *count_;
};

// FCL: the part's triangles and the tool's three shapes. A tool that lies in the part without touching its surface is free to it.
class FclValidity : public ob::StateValidityChecker {
  public:
    FclValidity(const ob::SpaceInformationPtr &si, const Part &part, Count *count) : StateValidityChecker(si), count_(count) {
        auto mesh = std::make_shared<fcl::BVHModel<fcl::OBBRSSd>>();
        std::vector<fcl::Triangle> triangles;
        for (const auto &t : part.triangles) triangles.emplace_back(t[0], t[1], t[2]);
        mesh->beginModel();
        mesh->addSubModel(part.vertices, triangles);
        mesh->endModel();
        part_ = std::make_unique<fcl::CollisionObjectd>(mesh);
        add(std::make_shared<fcl::Sphered>(BALL), BALL);
        add(std::make_shared<fcl::Cylinderd>(BALL, SHANK_END - BALL), 0.5 * (BALL + SHANK_END));
        add(std::make_shared<fcl::Cylinderd>(HOLDER, HOLDER_END - SHANK_END), 0.5 * (SHANK_END + HOLDER_END));
    }

    bool isValid(const ob::State *state) const override {
        count_->poses++;
        if (!si_->satisfiesBounds(state)) return false;
        const Eigen::Quaterniond turn = ToolSpace::rotation(state);
        for (const auto &[shape, height] : tool_) {
            fcl::Transform3d place = fcl::Transform3d::Identity();
            place.linear() = turn.toRotationMatrix();
            place.translation() = ToolSpace::position(state) + height * (turn * Vector::UnitZ());
            shape->setTransform(place);
            shape->computeAABB();
            fcl::CollisionRequestd request;
            fcl::CollisionResultd result;
            if (fcl::collide(shape.get(), part_.get(), request, result) > 0) return false;
        }
        return true;
    }

  private:
    void add(const std::shared_ptr<fcl::CollisionGeometryd> &shape, double height) {
        tool_.emplace_back(std::make_unique<fcl::CollisionObjectd>(shape), height);
    }

    std::unique_ptr<fcl::CollisionObjectd> part_;
    std::vector<std::pair<std::unique_ptr<fcl::CollisionObjectd>, double>> tool_;
    Count *count_;
};

struct Solved {
    bool found;
    double seconds;
    og::PathGeometric path;
};

static Solved solve(const ob::SpaceInformationPtr &si, const ob::State *start, const ob::State *goal) {
    og::SimpleSetup setup(si);
    setup.setPlanner(std::make_shared<og::RRTConnect>(si));
    setup.setStartAndGoalStates(ob::ScopedState<>(si->getStateSpace(), start), ob::ScopedState<>(si->getStateSpace(), goal), 1e-6);
    const auto begun = Clock::now();
    const bool found = setup.solve(MOST) == ob::PlannerStatus::EXACT_SOLUTION;
    const double seconds = std::chrono::duration<double>(Clock::now() - begun).count();
    return {found, seconds, found ? setup.getSolutionPath() : og::PathGeometric(si)};
}

static double median(std::vector<double> values) {
    if (values.empty()) return NAN;
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

int main(int count_of, char **words) {
    if (count_of < 3) {
        std::fprintf(stderr, "usage: plan PART.obj TOOL.toml [PROBLEMS]\n");
        return 2;
    }
    const int problems = count_of > 3 ? std::atoi(words[3]) : 20;
    ompl::msg::setLogLevel(ompl::msg::LOG_ERROR);
    ompl::RNG::setSeed(1);
    const Part part = read_obj(words[1]);

    ImfWorld *world = nullptr;
    ImfChecker *checker = nullptr;
    require(imf_world_create(IMF_UNIT_MM, PITCH, &world));
    ImfMesh mesh = {};
    mesh.name = "part";
    // Every voxel that the surface touches is solid, and the tool keeps half a voxel's diagonal off the centres: what is free to imf is
    // free of the triangles.
    mesh.conservative = true;
    const ImfPose here = {{0, 0, 0}, {0, 0, 0, 1}};
    uint64_t id;
    auto begun = Clock::now();
    require(imf_world_add_file(world, words[1], &mesh, &here, &id));
    const double room = 0.8661 * PITCH, clearance[3] = {room, room, room};
    require(imf_checker_create(world, words[2], clearance, &checker));
    const double made = std::chrono::duration<double>(Clock::now() - begun).count();

    auto space = std::make_shared<ToolSpace>();
    Vector low = part.vertices[0], high = low;
    for (const auto &v : part.vertices) low = low.cwiseMin(v), high = high.cwiseMax(v);
    ob::RealVectorBounds bounds(3);
    for (int axis = 0; axis < 3; axis++) bounds.setLow(axis, low[axis] - 120), bounds.setHigh(axis, high[axis] + 120);
    space->setBounds(bounds);

    Count of_imf, of_fcl;
    auto by_imf = std::make_shared<ob::SpaceInformation>(space), by_fcl = std::make_shared<ob::SpaceInformation>(space);
    by_imf->setStateValidityChecker(std::make_shared<ImfValidity>(by_imf, checker, &of_imf));
    auto imf_motions = std::make_shared<ImfMotions>(by_imf, checker, &of_imf);
    by_imf->setMotionValidator(imf_motions);
    begun = Clock::now();
    auto fcl_validity = std::make_shared<FclValidity>(by_fcl, part, &of_fcl);
    const double fcl_made = std::chrono::duration<double>(Clock::now() - begun).count();
    by_fcl->setStateValidityChecker(fcl_validity);
    by_fcl->setStateValidityCheckingResolution(STEP / space->getMaximumExtent());
    by_imf->setup();
    by_fcl->setup();

    // Starts and goals within 1.5 to 8 mm of the part, free to both.
    std::mt19937_64 random(7);
    auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
    std::vector<ob::State *> ends;
    while (ends.size() < 2 * static_cast<size_t>(problems)) {
        ob::State *state = space->allocState();
        Vector axis(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
        const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(Vector::UnitZ(), axis.normalized());
        auto *own = state->as<ob::SE3StateSpace::StateType>();
        own->setXYZ(uniform(low.x() - 9, high.x() + 9), uniform(low.y() - 9, high.y() + 9), uniform(low.z() - 9, high.z() + 9));
        own->rotation().x = turn.x(), own->rotation().y = turn.y(), own->rotation().z = turn.z(), own->rotation().w = turn.w();
        const ImfPose pose = pose_of(state);
        ImfDistance distance;
        require(imf_checker_distance(checker, &pose, &distance));
        const bool near = distance.lower > 1.5 - room && distance.upper < 8.0 - room && fcl_validity->isValid(state);
        if (near) ends.push_back(state); else space->freeState(state);
    }

    std::vector<double> times_imf, times_fcl, ratios;
    size_t cut = 0, motions = 0, grazed = 0, checked = 0;
    of_imf = {}, of_fcl = {};
    double all_imf = 0, all_fcl = 0;
    for (int problem = 0; problem < problems; problem++) {
        const ob::State *start = ends[2 * problem], *goal = ends[2 * problem + 1];
        const Solved one = solve(by_imf, start, goal), other = solve(by_fcl, start, goal);
        all_imf += one.seconds, all_fcl += other.seconds;
        if (one.found) times_imf.push_back(one.seconds);
        if (other.found) times_fcl.push_back(other.seconds);
        if (one.found && other.found) ratios.push_back(other.seconds / one.seconds);
        Count aside = of_imf;
        for (size_t i = 1; other.found && i < other.path.getStateCount(); i++, motions++)
            cut += imf_motions->ask(other.path.getState(i - 1), other.path.getState(i)).free_until < 1.0;
        of_imf = aside, aside = of_fcl;
        // imf's ways by FCL, a tenth as far apart.
        ob::State *at = space->allocState();
        for (size_t i = 1; one.found && i < one.path.getStateCount(); i++, checked++) {
            const ob::State *a = one.path.getState(i - 1), *b = one.path.getState(i);
            const int steps = 1 + static_cast<int>(10.0 * space->distance(a, b) / STEP);
            bool free = true;
            for (int step = 0; free && step <= steps; step++) {
                space->interpolate(a, b, static_cast<double>(step) / steps, at);
                free = fcl_validity->isValid(at);
            }
            grazed += !free;
        }
        space->freeState(at);
        of_fcl = aside;
    }
    std::printf("%d problems, part of %zu triangles, imf's voxels %.1f mm (made in %.2f s), FCL's poses every %.1f mm (made in %.2f s)\n",
                problems, part.triangles.size(), PITCH, made, STEP, fcl_made);
    std::printf("%-5s %8s %12s %12s %14s %14s\n", "", "solved", "median, s", "all, s", "poses asked", "motions asked");
    std::printf("%-5s %8zu %12.4f %12.2f %14zu %14zu\n", "imf", times_imf.size(), median(times_imf), all_imf, of_imf.poses, of_imf.motions);
    std::printf("%-5s %8zu %12.4f %12.2f %14zu %14s\n", "FCL", times_fcl.size(), median(times_fcl), all_fcl, of_fcl.poses, "by poses");
    std::printf("FCL over imf where both solve: %.1f times as long in the median\n", median(ratios));
    std::printf("of %zu motions in FCL's ways imf finds a collision in %zu; of %zu in imf's FCL, at a tenth of the step, in %zu\n", motions, cut,
                checked, grazed);
    for (ob::State *state : ends) space->freeState(state);
    imf_checker_close(checker);
    imf_world_close(world);
    return 0;
}
