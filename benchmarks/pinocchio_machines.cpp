// Pinocchio with free-flyers and closed loops in a native loop, as a shared library for ctypes:
// one state after the other, nothing but the algorithm in the timed part.

#include <pinocchio/multibody.hpp>
#include <pinocchio/constraints.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include <cstring>
#include <vector>

using namespace pinocchio;
using Vector = Eigen::VectorXd;
using Rotation = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Contacts = std::vector<RigidConstraintModel, Eigen::aligned_allocator<RigidConstraintModel>>;
using ContactData = std::vector<RigidConstraintData, Eigen::aligned_allocator<RigidConstraintData>>;

namespace
{

enum Kind { Revolute, Prismatic, FreeFlyer };
enum Quantity { InverseDynamics, ForwardDynamics, ForwardDynamicsWorld, ConstraintDynamics };

struct Engine
{
  Model model;
  Data data;
  Contacts contacts;
  ContactData contact_data;
  ProximalSettings settings;
  std::vector<Vector> q, u, x;  // the states of the loop; x is udot or tau
};

// Axes are principal: joints of any other direction are slower.
JointModel joint(int kind, const Eigen::Vector3d & axis)
{
  if (kind == FreeFlyer) return JointModelFreeFlyer();
  int k;
  if (axis.maxCoeff(&k) < 1.0 - 1e-12) {
    if (kind == Prismatic) return JointModelPrismaticUnaligned(axis);
    return JointModelRevoluteUnaligned(axis);
  }
  if (kind == Prismatic) {
    if (k == 0) return JointModelPX();
    if (k == 1) return JointModelPY();
    return JointModelPZ();
  }
  if (k == 0) return JointModelRX();
  if (k == 1) return JointModelRY();
  return JointModelRZ();
}

SE3 placement(const double * x)  // rotation (9, rows), translation (3)
{
  return SE3(Eigen::Matrix3d(Eigen::Map<const Rotation>(x)),
             Eigen::Map<const Eigen::Vector3d>(x + 9));
}

const Vector & evaluate(Engine & e, int what, const Vector & q, const Vector & u,
                        const Vector & x)
{
  if (what == InverseDynamics) return rnea(e.model, e.data, q, u, x);
  if (what == ForwardDynamics) return aba(e.model, e.data, q, u, x, Convention::LOCAL);
  if (what == ForwardDynamicsWorld)
    return aba(e.model, e.data, q, u, x, Convention::WORLD);
  return constraintDynamics(e.model, e.data, q, u, x, e.contacts, e.contact_data, e.settings);
}

}  // namespace

extern "C" {

// joints: for each parent (-1: none), kind, axis (3), placement (12), mass, center of mass (3),
// inertia about it (9), armature. contacts: for each closure that joins two points, for both the
// joint (-1: the world) and the placement (12).
void * make(int count, const double * joints, const double * gravity, int closures,
            const double * contacts, double accuracy, double mu)
{
  Model model;
  model.gravity.linear() = Eigen::Map<const Eigen::Vector3d>(gravity);
  for (int i = 0; i < count; ++i) {
    const double * b = joints + 31 * i;
    const auto id = model.addJoint(
      static_cast<JointIndex>(b[0] + 1.0),
      joint(static_cast<int>(b[1]), Eigen::Map<const Eigen::Vector3d>(b + 2)), placement(b + 5),
      std::to_string(i));
    model.appendBodyToJoint(
      id, Inertia(b[17], Eigen::Map<const Eigen::Vector3d>(b + 18),
                  Eigen::Matrix3d(Eigen::Map<const Rotation>(b + 21))), SE3::Identity());
    if (model.joints[id].nv() == 1) model.armature[model.joints[id].idx_v()] = b[30];
  }
  Engine * e = new Engine{model, Data(model), {}, {}, ProximalSettings(accuracy, mu, 50),
                          {}, {}, {}};
  for (int i = 0; i < closures; ++i) {
    const double * c = contacts + 26 * i;
    e->contacts.emplace_back(
      CONTACT_3D, e->model, static_cast<JointIndex>(c[0] + 1.0), placement(c + 1),
      static_cast<JointIndex>(c[13] + 1.0), placement(c + 14), LOCAL);
  }
  for (const auto & contact : e->contacts) e->contact_data.emplace_back(contact);
  initConstraintDynamics(e->model, e->data, e->contacts, e->contact_data);
  return e;
}

void destroy(void * handle) { delete static_cast<Engine *>(handle); }

// Keep `count` states in rows, for `run`.
void keep(void * handle, int count, const double * q, const double * u, const double * x)
{
  Engine & e = *static_cast<Engine *>(handle);
  const int n = e.model.nv, m = e.model.nq;
  for (int i = 0; i < count; ++i) {
    e.q.emplace_back(Eigen::Map<const Vector>(q + m * i, m));
    e.u.emplace_back(Eigen::Map<const Vector>(u + n * i, n));
    e.x.emplace_back(Eigen::Map<const Vector>(x + n * i, n));
  }
}

// Evaluate a quantity once for every kept state.
void run(void * handle, int what)
{
  Engine & e = *static_cast<Engine *>(handle);
  for (std::size_t i = 0; i < e.q.size(); ++i) evaluate(e, what, e.q[i], e.u[i], e.x[i]);
}

// Write a quantity of a kept state, (nv,).
void answer(void * handle, int what, int i, double * out)
{
  Engine & e = *static_cast<Engine *>(handle);
  const Vector value = evaluate(e, what, e.q[i], e.u[i], e.x[i]);
  std::memcpy(out, value.data(), sizeof(double) * value.size());
}

}  // extern "C"
