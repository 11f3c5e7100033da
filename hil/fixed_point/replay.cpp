// Replays records from stdin through filters and controllers: `replay-fixed` with integers,
// `replay-double` with floating point. Kinds of records: S Start, T Step, F Filter, each after its
// letter. Answers on stdout: for T an Output, for F a Measured, as doubles. `--repeat N` runs the
// records N times, answers nothing, and prints the nanoseconds per T or F.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "replay_core.hpp"

namespace {

using Clock = std::chrono::steady_clock;

struct Answer {
    double values[5];
};

template <class T> T taken(const std::string &records, std::size_t &at) {
    T out;
    if (at + sizeof out > records.size()) {
        std::fprintf(stderr, "replay: the last record is not complete\n");
        std::exit(2);
    }
    std::memcpy(&out, records.data() + at, sizeof out);
    at += sizeof out;
    return out;
}

struct Run {
    replay::Controller controller;
    replay::Filters filters;
    std::vector<Answer> answers;
    bool keeps = true;
    long steps = 0;

    void replay_all(const std::string &records) {
        for (std::size_t at = 0; at < records.size();) {
            const char kind = records[at++];
            if (kind == 'S') {
                controller.start(taken<replay::Start>(records, at));
            } else if (kind == 'T') {
                controller.take(taken<replay::Step>(records, at));
                controller.step();
                keep(controller.output());
            } else if (kind == 'F') {
                filters.take(taken<replay::Filter>(records, at));
                filters.step();
                keep(filters.output());
            } else {
                std::fprintf(stderr, "replay: no record is of the kind %c\n", kind);
                std::exit(2);
            }
        }
    }

    void keep(const replay::Output &out) {
        const double state = out.state, reason = out.stop_reason, blows = out.blows;
        push({{static_cast<double>(out.requested_q15), static_cast<double>(out.estimate), state,
               reason, blows}});
    }
    void keep(const replay::Measured &out) {
        push({{static_cast<double>(out.current_a_q9), static_cast<double>(out.speed_rpm_q1), 0, 0,
               0}});
    }
    void push(const Answer &answer) {
        ++steps;
        if (keeps) {
            answers.push_back(answer);
        }
    }
};

std::string all_of(std::FILE *file) {
    std::string out;
    char buffer[65536];
    for (std::size_t n = 0; (n = std::fread(buffer, 1, sizeof buffer, file)) > 0;) {
        out.append(buffer, n);
    }
    return out;
}

}  // namespace

int main(int count, char **arguments) {
    const bool timing = count == 3 && std::strcmp(arguments[1], "--repeat") == 0;
    const std::string records = all_of(stdin);
    Run run;
    run.keeps = !timing;
    const auto begin = Clock::now();
    for (int left = timing ? std::atoi(arguments[2]) : 1; left > 0; --left) {
        run.filters = replay::Filters();
        run.replay_all(records);
    }
    if (timing) {
        const std::chrono::duration<double, std::nano> took = Clock::now() - begin;
        std::printf("%.3f\n", took.count() / static_cast<double>(run.steps));
    } else {
        std::fwrite(run.answers.data(), sizeof(Answer), run.answers.size(), stdout);
    }
    return 0;
}
