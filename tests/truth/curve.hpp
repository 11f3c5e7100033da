// Piecewise linear curve through points with ascending times; a step is two points at one time.
#pragma once

namespace truth {

class Curve {
public:
    Curve(const double *t, const double *y, int n) : t_(t), y_(y), n_(n) {}

    // Linear between the points. The times asked for must not fall.
    double at(double t) {
        if (n_ == 0) {
            return 0.0;
        }
        while (k_ + 1 < n_ && t_[k_ + 1] <= t) {
            ++k_;
        }
        if (t <= t_[k_] || k_ + 1 >= n_) {
            return y_[k_];
        }
        return y_[k_] + (y_[k_ + 1] - y_[k_]) * (t - t_[k_]) / (t_[k_ + 1] - t_[k_]);
    }

    // The value of the last point before t.
    double held(double t) {
        (void)at(t);
        return n_ > 0 ? y_[k_] : 0.0;
    }

private:
    const double *t_, *y_;
    int n_, k_ = 0;
};

}  // namespace truth
