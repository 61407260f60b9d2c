// Pinocchio in a native loop, as a shared library for ctypes: one state after the other, nothing
// but the algorithm in the timed part.

#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include <cstring>
#include <functional>
#include <map>
#include <string>
#include <vector>

using namespace pinocchio;
using Vector = Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Rotation = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using States = Eigen::Map<const Eigen::MatrixXd>;

namespace
{

struct Engine
{
  Model model;
  Data data;
  Eigen::MatrixXd dq, du, da;
  std::vector<Vector> q, u, x;  // the states of the loop; x is udot or tau
};

// Axis, 1 or 2 or 3 for x, y, z; 0 for any other direction.
int principal(const Eigen::Vector3d & axis)
{
  for (int k = 0; k < 3; ++k)
    if ((axis - Eigen::Vector3d::Unit(k)).norm() < 1e-12) return k + 1;
  return 0;
}

JointIndex add(Model & model, JointIndex parent, bool slides, const Eigen::Vector3d & axis,
               const SE3 & placement, const std::string & name)
{
  const int k = principal(axis);
  if (slides) {
    if (k == 1) return model.addJoint(parent, JointModelPX(), placement, name);
    if (k == 2) return model.addJoint(parent, JointModelPY(), placement, name);
    if (k == 3) return model.addJoint(parent, JointModelPZ(), placement, name);
    return model.addJoint(parent, JointModelPrismaticUnaligned(axis), placement, name);
  }
  if (k == 1) return model.addJoint(parent, JointModelRX(), placement, name);
  if (k == 2) return model.addJoint(parent, JointModelRY(), placement, name);
  if (k == 3) return model.addJoint(parent, JointModelRZ(), placement, name);
  return model.addJoint(parent, JointModelRevoluteUnaligned(axis), placement, name);
}

using Algorithm = std::function<void(Engine &, const Vector &, const Vector &, const Vector &)>;

// What is timed; `answer` below copies the result out, untimed.
const std::map<std::string, Algorithm> & algorithms()
{
  static const std::map<std::string, Algorithm> table = {
    {"inverse_dynamics", [](Engine & e, const Vector & q, const Vector & u, const Vector & x) {
       rnea(e.model, e.data, q, u, x); }},
    {"bias_force", [](Engine & e, const Vector & q, const Vector & u, const Vector &) {
       nonLinearEffects(e.model, e.data, q, u); }},
    {"gravity_force", [](Engine & e, const Vector & q, const Vector &, const Vector &) {
       computeGeneralizedGravity(e.model, e.data, q); }},
    {"forward_dynamics", [](Engine & e, const Vector & q, const Vector & u, const Vector & x) {
       aba(e.model, e.data, q, u, x, Convention::LOCAL); }},
    {"forward_dynamics/world", [](Engine & e, const Vector & q, const Vector & u,
                                  const Vector & x) {
       aba(e.model, e.data, q, u, x, Convention::WORLD); }},
    {"mass_matrix", [](Engine & e, const Vector & q, const Vector &, const Vector &) {
       crba(e.model, e.data, q, Convention::LOCAL); }},
    {"mass_matrix/world", [](Engine & e, const Vector & q, const Vector &, const Vector &) {
       crba(e.model, e.data, q, Convention::WORLD); }},
    {"inverse_mass_matrix", [](Engine & e, const Vector & q, const Vector &, const Vector &) {
       computeMinverse(e.model, e.data, q); }},
    {"coriolis_matrix", [](Engine & e, const Vector & q, const Vector & u, const Vector &) {
       computeCoriolisMatrix(e.model, e.data, q, u); }},
    {"inverse_dynamics_derivatives",
     [](Engine & e, const Vector & q, const Vector & u, const Vector & x) {
       computeRNEADerivatives(e.model, e.data, q, u, x, e.dq, e.du, e.da); }},
    {"forward_dynamics_derivatives",
     [](Engine & e, const Vector & q, const Vector & u, const Vector & x) {
       computeABADerivatives(e.model, e.data, q, u, x); }},
    {"regressor", [](Engine & e, const Vector & q, const Vector & u, const Vector & x) {
       computeJointTorqueRegressor(e.model, e.data, q, u, x); }},
  };
  return table;
}

Eigen::MatrixXd symmetric(const Eigen::MatrixXd & upper)
{
  return upper.selfadjointView<Eigen::Upper>();
}

// The last result, stacked by rows.
Eigen::MatrixXd result(const Engine & e, const std::string & name)
{
  const std::string what = name.substr(0, name.find('/'));
  const Data & d = e.data;
  const auto n = e.model.nv;
  Eigen::MatrixXd three(3 * n, n);
  if (what == "inverse_dynamics") return d.tau;
  if (what == "bias_force") return d.nle;
  if (what == "gravity_force") return d.g;
  if (what == "forward_dynamics") return d.ddq;
  if (what == "mass_matrix") return symmetric(d.M);
  if (what == "inverse_mass_matrix") return symmetric(d.Minv);
  if (what == "coriolis_matrix") return d.C;
  if (what == "regressor") return d.jointTorqueRegressor;
  if (what == "inverse_dynamics_derivatives")
    three << e.dq, e.du, symmetric(e.da);
  else
    three << d.ddq_dq, d.ddq_dv, symmetric(d.Minv);
  return three;
}

Engine * engine(void * handle) { return static_cast<Engine *>(handle); }

}  // namespace

extern "C" {

// bodies: for each body parent (-1: none), 1 if it slides, axis (3), rotation (9, rows),
// translation (3), mass, centre of mass (3), inertia about it (9), in the order of the coordinates.
void * make(int n, const double * bodies, const double * gravity)
{
  Model model;
  model.gravity.linear() = Eigen::Map<const Eigen::Vector3d>(gravity);
  for (int i = 0; i < n; ++i) {
    const double * b = bodies + 30 * i;
    const SE3 placement(Eigen::Matrix3d(Eigen::Map<const Rotation>(b + 5)),
                        Eigen::Map<const Eigen::Vector3d>(b + 14));
    const auto id = add(model, static_cast<JointIndex>(b[0] + 1.0), b[1] != 0.0,
                        Eigen::Map<const Eigen::Vector3d>(b + 2), placement, std::to_string(i));
    const Inertia inertia(b[17], Eigen::Map<const Eigen::Vector3d>(b + 18),
                          Eigen::Matrix3d(Eigen::Map<const Rotation>(b + 21)));
    model.appendBodyToJoint(id, inertia, SE3::Identity());
  }
  const Eigen::MatrixXd zero = Eigen::MatrixXd::Zero(model.nv, model.nv);
  return new Engine{model, Data(model), zero, zero, zero, {}, {}, {}};
}

void destroy(void * handle) { delete engine(handle); }

// Write the result for one state to `out`, rows first; return its size, -1 for an unknown name.
int answer(void * handle, const char * what, const double * q, const double * u,
           const double * x, double * out)
{
  const auto found = algorithms().find(what);
  if (found == algorithms().end()) return -1;
  Engine & e = *engine(handle);
  const int n = e.model.nv;
  found->second(e, Eigen::Map<const Vector>(q, n), Eigen::Map<const Vector>(u, n),
                Eigen::Map<const Vector>(x, n));
  const RowMajor value = result(e, what);
  std::memcpy(out, value.data(), sizeof(double) * value.size());
  return static_cast<int>(value.size());
}

// Keep `count` states, each a row of n numbers, for `run`.
void keep(void * handle, int count, const double * q, const double * u, const double * x)
{
  Engine & e = *engine(handle);
  const int n = e.model.nv;
  e.q.clear();
  e.u.clear();
  e.x.clear();
  for (int i = 0; i < count; ++i) {
    e.q.emplace_back(Eigen::Map<const Vector>(q + n * i, n));
    e.u.emplace_back(Eigen::Map<const Vector>(u + n * i, n));
    e.x.emplace_back(Eigen::Map<const Vector>(x + n * i, n));
  }
}

// Call an algorithm once for every kept state.
void run(void * handle, const char * what)
{
  Engine & e = *engine(handle);
  const Algorithm & algorithm = algorithms().at(what);
  for (std::size_t i = 0; i < e.q.size(); ++i) algorithm(e, e.q[i], e.u[i], e.x[i]);
}

// An algorithm at `count` states in rows, each result a row of `out`: vectors and the Jacobian of
// the last joint (6 rows, world axes, at its origin) as they are, derivatives by q, u and udot
// column by column, of the last the upper triangle alone. Return -1 for an unknown name.
int batch(void * handle, const char * what, int count, const double * q, const double * u,
          const double * x, double * out)
{
  Engine & e = *engine(handle);
  const int n = e.model.nv;
  const JointIndex last = e.model.njoints - 1;
  const std::string name = what;
  const States qs(q, n, count), us(u, n, count), xs(x, n, count);
  Eigen::Map<Eigen::MatrixXd> vectors(out, n, count);
  if (name == "inverse_dynamics") {
    for (int i = 0; i < count; ++i)
      vectors.col(i) = rnea(e.model, e.data, qs.col(i), us.col(i), xs.col(i));
  } else if (name == "forward_dynamics") {
    for (int i = 0; i < count; ++i)
      vectors.col(i) = aba(e.model, e.data, qs.col(i), us.col(i), xs.col(i), Convention::LOCAL);
  } else if (name == "partial_velocities") {
    for (int i = 0; i < count; ++i) {
      Eigen::Map<Data::Matrix6x> J(out + 6 * n * i, 6, n);
      computeJointJacobians(e.model, e.data, qs.col(i));
      J.setZero();
      getJointJacobian(e.model, e.data, last, LOCAL_WORLD_ALIGNED, J);
    }
  } else if (name == "inverse_dynamics_derivatives") {
    for (int i = 0; i < count; ++i) {
      Eigen::Map<Eigen::MatrixXd> rows(out + 3 * n * n * i, n, 3 * n);
      computeRNEADerivatives(e.model, e.data, qs.col(i), us.col(i), xs.col(i), e.dq, e.du, e.da);
      rows.leftCols(n) = e.dq;
      rows.middleCols(n, n) = e.du;
      rows.rightCols(n) = e.da;
    }
  } else {
    return -1;
  }
  return 0;
}

// Runge-Kutta steps under a held torque from state (q, u), which is overwritten.
void simulate(void * handle, int steps, double h, const double * held, double * state)
{
  Engine & e = *engine(handle);
  const int n = e.model.nv;
  const Vector tau = Eigen::Map<const Vector>(held, n);
  Vector q = Eigen::Map<const Vector>(state, n), u = Eigen::Map<const Vector>(state + n, n);
  Vector k1(n), k2(n), k3(n), k4(n), u2(n), u3(n), u4(n), at(n);
  const auto udot = [&](const Vector & q, const Vector & u) -> const Vector & {
    return aba(e.model, e.data, q, u, tau, Convention::LOCAL);
  };
  for (int s = 0; s < steps; ++s) {
    k1 = udot(q, u);
    u2 = u + h / 2.0 * k1;
    at = q + h / 2.0 * u;
    k2 = udot(at, u2);
    u3 = u + h / 2.0 * k2;
    at = q + h / 2.0 * u2;
    k3 = udot(at, u3);
    u4 = u + h * k3;
    at = q + h * u3;
    k4 = udot(at, u4);
    q += h / 6.0 * (u + 2.0 * u2 + 2.0 * u3 + u4);
    u += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
  }
  Eigen::Map<Vector>(state, n) = q;
  Eigen::Map<Vector>(state + n, n) = u;
}

}  // extern "C"
